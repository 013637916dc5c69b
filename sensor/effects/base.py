"""What the parameter models of all effects have in common.

An effect is one field of `Sensor`, most of them by `fields`, and acts in the order of its stage;
within a stage effects act in the order of the fields. Default parameters do nothing.

One on rates overrides `act_on_rates`. One on single avalanches, whose stage is `AVALANCHES`, has a
part in `avalanches/kernel.py`; wherever no law of the counts is known it is simulated. No other
file names an effect unless it states a law of it.
"""

from dataclasses import dataclass, field
from enum import IntEnum, auto
from typing import ClassVar

import numpy as np
from pydantic import BaseModel

from megalopta.core.arrays import Floats


class Stage(IntEnum):
    """Light on the pixels, a device as it was made, what its operation makes of it, then events."""

    LIGHT = auto()
    DEVICE = auto()
    OPERATION = auto()
    AVALANCHES = auto()
    READOUT = auto()


@dataclass
class PixelRates:
    """What the pixels of a device do to rates; effects on rates change it one after the other."""

    shape: tuple[int, int]
    """Rows and columns"""

    device_seed: int
    active_area_m2: float
    """Light-sensitive area of a pixel"""

    efficiency_factor: Floats
    """Detection efficiency relative to the sensor's curve, (H, W)"""

    dark_counts_hz: Floats
    """Dark count rate, (H, W)"""

    breakdown_offset_v: Floats | None = None
    """Breakdown voltage above the nominal one, (H, W), where it was measured"""

    breakdown_shift_v: float = 0.0
    """Rise of every breakdown voltage since the reference temperature"""

    factors: dict[str, Floats] = field(default_factory=dict)
    """On the values of dead_time, afterpulsing and crosstalk, (H, W); not named: 1"""

    measured: set[str] = field(default_factory=set)
    """What was measured, at the reference bias and temperature"""

    def scale(self, name: str, factor: Floats) -> None:
        """Multiply one of `factors`."""
        self.factors[name] = self.factors.get(name, np.ones(self.shape)) * factor


class Effect(
    BaseModel, frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
):
    """Parameters of one effect."""

    stage: ClassVar[Stage]
    statement: ClassVar[str]
    """What it does, for a reader"""

    @property
    def is_on(self) -> bool:
        """Whether it does anything."""
        return self != self.off()

    @property
    def memory_s(self) -> float:
        """Time after which a pixel has forgotten what the effect left of its past, s."""
        return 0.0

    @classmethod
    def off(cls) -> "Effect":
        """Return an effect in its place that does nothing (a lens: a perfect one)."""
        return cls()

    def act_on_rates(self, rates: PixelRates) -> None:
        """Change the rates of the pixels, in place; by default nothing."""
