"""Recorded readings at one light and one exposure, and how often a pixel gave which code."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints

_DEVIATIONS_ABOVE_BOTTOM = 6.0
_DEEPEST = 0.95
"""Of the swing: offsets move the bottom too."""


@dataclass(frozen=True, eq=False)
class Level:
    """Frames that were taken alike.

    Attributes
    ----------
    codes : (n, rows, columns) integers
        Of the ADC; fewer where more was counted.
    exposure_s : float
    light_hz : float
        Photons per second on a pixel, or, where all levels share it, in any unit; 0: in the dark.
    """

    codes: NDArray[Any]
    exposure_s: float
    light_hz: float = 0.0

    @property
    def is_dark(self) -> bool:
        """Whether there was no light."""
        return self.light_hz == 0

    def __str__(self) -> str:
        """Name it for people."""
        light = "dark" if self.is_dark else f"light of {self.light_hz:g}"
        return f"{light}, exposure of {self.exposure_s:g} s"


class Adc(NamedTuple):
    """What turns codes into volts below the output after reset."""

    lsb_v: float
    """Between two codes (V)."""
    top: float
    """Code of the nominal output after reset."""
    bottom: float
    """Code at the nominal bottom of the swing."""

    @property
    def swing_v(self) -> float:
        """How far the output can fall (V)."""
        return (self.top - self.bottom) * self.lsb_v


class Falls(NamedTuple):
    """How often (entry) a pixel at a level showed a fall of its output, and sums of that.

    Entries are (E,), maps (levels, pixels).
    """

    level: Ints
    pixel: Ints
    fall_v: Floats
    times: Floats
    frames: Floats
    """0 where a pixel came near its bottom and is left out."""
    mean_v: Floats
    variance_v2: Floats
    is_cut: bool
    """Whether any output was above what the ADC can read: the noise of readings of no count is cut
    off."""

    def at(self, chosen: NDArray[np.bool_]) -> "Falls":
        """Keep the entries that are chosen, (E,)."""
        return self._replace(
            level=self.level[chosen],
            pixel=self.pixel[chosen],
            fall_v=self.fall_v[chosen],
            times=self.times[chosen],
        )


def falls_of(levels: Sequence[Level], adc: Adc) -> Falls:
    """Gather how the outputs fell; levels where a pixel may have met its bottom are left out."""
    pixels = levels[0].codes[0].size
    lowest = adc.top - _DEEPEST * (adc.top - adc.bottom)
    parts, maps = [], []
    for number, level in enumerate(levels):
        codes = level.codes.reshape(len(level.codes), pixels)
        mean, variance = codes.mean(axis=0), codes.var(axis=0, ddof=1)
        usable = mean - _DEVIATIONS_ABOVE_BOTTOM * np.sqrt(variance) > lowest
        maps.append((np.where(usable, len(codes), 0), mean, variance))
        least, size = int(codes.min()), int(np.ptp(codes)) + 1
        keys = (codes.astype(np.int64) - least) + size * np.arange(pixels)
        seen = np.bincount(keys[:, usable].ravel(), minlength=pixels * size)
        at = np.flatnonzero(seen)
        parts.append((np.full(at.size, number), at // size, at % size + least, seen[at]))
    level_of, pixel, code, times = (np.concatenate(each) for each in zip(*parts, strict=True))
    frames, mean, variance = (np.array(each, np.float64) for each in zip(*maps, strict=True))
    fall_v = (adc.top - code) * adc.lsb_v
    mean_v, variance_v2 = (adc.top - mean) * adc.lsb_v, variance * adc.lsb_v**2
    is_cut = bool(code.max(initial=0) >= np.rint(adc.top))
    return Falls(level_of, pixel, fall_v, times.astype(float), frames, mean_v, variance_v2, is_cut)
