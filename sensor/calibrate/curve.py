"""Fall of an output over the number of events, where the step changes over the swing.

Of the mean step s, slope σ and swing S, N events make, in steps,

    x = (1 + σ/2)·(1 − (1 − b)^N)/b       b = σ·s/S        N = log(1 − b·x/(1 + σ/2))/log(1 − b)

Source: `sensor/spad/analog.py`.
"""

from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats

_NUDGE = 1e-4


class Curve(NamedTuple):
    """How the step changes over the swing."""

    swing_v: float
    slope: float = 0.0
    """How much smaller it is at the bottom than at the top, relative."""

    def steps(self, numbers: Floats, step_v: Floats) -> Floats:
        """Fall after so many events, in steps; step_v (V) broadcasts."""
        if self.slope == 0:
            return numbers
        b = self.slope * step_v / self.swing_v
        return np.asarray(-(1 + self.slope / 2) / b * np.expm1(numbers * np.log1p(-b)))

    def numbers(self, steps: Floats, step_v: Floats) -> Floats:
        """Events after which it has fallen by so many steps, not rounded."""
        if self.slope == 0:
            return steps
        b = self.slope * step_v / self.swing_v
        left = np.maximum(1 - b * steps / (1 + self.slope / 2), 1e-9)
        return np.asarray(np.log(left) / np.log1p(-b))

    def bend(self, numbers: Floats, step_v: Floats) -> Floats:
        """Derivative of `steps` by the slope."""
        low, high = (
            self._replace(slope=self.slope + way * _NUDGE).steps(numbers, step_v) for way in (-1, 1)
        )
        return (high - low) / (2 * _NUDGE)
