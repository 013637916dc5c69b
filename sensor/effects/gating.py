"""Gating: the pixel is sensitive only in a periodic window.

Arrivals outside the window have no effect; a dead time that has started continues. Open time is
therefore the clock of the arrivals; `open_time` and `wall_time` convert between the clocks.

Without dead time counts are Poisson with mean and variance r·(open time in the exposure).

Source: dissertation §2.3.2.
"""

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor.effects.base import Effect


class Gate(Effect, frozen=True):
    """Periodic window of sensitivity; always open by default."""

    period_s: Annotated[float, Field(gt=0)] | None = None
    """Time from one opening to the next (s); null: not gated."""
    width_s: Annotated[float, Field(gt=0)] | None = None
    """Time for which the window is open (s), at most the period."""
    phase_s: Annotated[float, Field(ge=0)] = 0.0
    """Time of the first opening after the start of the exposure (s), below the period."""

    @model_validator(mode="after")
    def _check_window(self) -> Self:
        if (self.period_s is None) != (self.width_s is None):
            raise ValueError("gate: period_s and width_s belong together; give both or none")
        if self.period_s is None or self.width_s is None:
            return self
        if self.width_s > self.period_s or self.phase_s >= self.period_s:
            raise ValueError(
                f"gate: width_s {self.width_s:g} and phase_s {self.phase_s:g} must fit into the "
                f"period_s {self.period_s:g}"
            )
        return self

    @property
    def is_on(self) -> bool:
        """True if the pixel is ever closed."""
        return self.width_s != self.period_s

    @property
    def window(self) -> tuple[float, float, float]:
        """Period, width and phase, s; period 0: not gated."""
        return self.period_s or 0.0, self.width_s or 0.0, self.phase_s


def open_fraction(gate: Gate, exposure_s: float) -> float:
    """Fraction of the exposure for which the window is open."""
    return float(open_time(exposure_s, *gate.window) - open_time(0.0, *gate.window)) / exposure_s


def part_weights(gate: Gate, exposure_s: float, parts: int) -> Floats:
    """Share of the open time in each of a number of equal parts of the exposure, (parts,)."""
    borders = np.linspace(0, exposure_s, parts + 1)
    opened = np.diff([open_time(border, *gate.window) for border in borders])
    return np.asarray(opened / opened.sum())


@compiled
def open_time(time_s: float, period_s: float, width_s: float, phase_s: float) -> float:
    """Open time between the first opening and a time, s; period 0: not gated."""
    if period_s == 0:
        return time_s
    cycle = np.floor((time_s - phase_s) / period_s)
    opened: float = cycle * width_s + min(time_s - phase_s - cycle * period_s, width_s)
    return opened


@compiled
def wall_time(open_s: float, period_s: float, width_s: float, phase_s: float) -> float:
    """Time at which this much open time has elapsed, s: the inverse of `open_time`."""
    if period_s == 0:
        return open_s
    cycle = np.floor(open_s / width_s)
    time: float = phase_s + cycle * period_s + (open_s - cycle * width_s)
    return time


@compiled
def is_open(time_s: float, period_s: float, width_s: float, phase_s: float) -> bool:
    """True if the window is open."""
    return bool(period_s == 0 or (time_s - phase_s) % period_s < width_s)
