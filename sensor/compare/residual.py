"""One level in the course of a comparison, and its standardized readings.

Readings of a pixel are standardized, z = (x − mean)/σ, so that no bright or noisy pixel dominates.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.faults import Fault
from megalopta.sensor.compare.model import Model

_FAR = 4
_SMALL = 0.01


class Standardized(NamedTuple):
    """Standardized readings of good pixels."""

    z: Floats
    """Readings less their mean, over their σ (n, rows, columns); 0 for other pixels"""
    sigma: Floats
    """(rows, columns)"""
    varies: Mask
    """Good pixels that vary"""

    @classmethod
    def of(cls, signal: NDArray[Any], good: Mask) -> "Standardized":
        """Standardize readings (n, rows, columns)."""
        signal = np.asarray(signal, np.float32)
        sigma = signal.std(axis=0)
        varies = good & (sigma > 0)
        z = np.asarray((signal - signal.mean(axis=0)) / np.where(varies, sigma, np.inf))
        return cls(z, sigma, varies)

    @property
    def mean(self) -> Floats:
        """Mean of z over the pixels that vary, (n,)."""
        return np.asarray(self.z.sum(axis=(1, 2)) / max(int(self.varies.sum()), 1), np.float64)

    def reach(self, change: Floats) -> float:
        """Return the change of the mean of z if counts change by this map."""
        varies = self.varies
        return float((change[varies] / self.sigma[varies]).mean()) if varies.any() else 0.0

    def far_correlation(self) -> tuple[float, float]:
        """Return the mean correlation of pixels at least four rows apart, and its error."""
        rows = self.z.sum(axis=2)[:, np.newaxis]
        return _far_correlation(rows, self.varies.sum(axis=1)[np.newaxis])

    def line_correlation(self, name: str) -> tuple[float, float]:
        """Return the mean correlation of pixels of one "row" or "column", four or more apart."""
        if name == "row":
            return _far_correlation(self.z, self.varies)
        return _far_correlation(self.z.swapaxes(1, 2), self.varies.T)


def _far_correlation(z: Floats, number: NDArray[Any]) -> tuple[float, float]:
    """Mean correlation along lines (n, lines, P) of sums of so many pixels, and its error."""
    if z.shape[2] <= _FAR:
        return 0.0, np.inf
    later = np.cumsum(z[:, :, ::-1], axis=2)[:, :, ::-1]
    later_number = np.cumsum(number[:, ::-1].astype(float), axis=1)[:, ::-1]
    pairs = float((number[:, :-_FAR] * later_number[:, _FAR:]).sum())
    if not pairs:
        return 0.0, np.inf
    values = (z[:, :, :-_FAR] * later[:, :, _FAR:]).sum(axis=(1, 2)) / pairs
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))


@dataclass
class Residual:
    """Captured and expected frames of a level: each fault that is found is taken out."""

    captured: Level
    expected: Level
    model: Model
    rate_hz: Floats
    """Detection rates that the model expects, (n or 1, rows, columns)"""
    error: Floats
    """Standard errors (rows, columns) of expected mean counts; NaN: unknown"""
    masked: Mask
    """Pixels that are not compared, (rows, columns)"""
    uncertainty: dict[str, float] = field(default_factory=dict)
    """What fluctuations leave uncertain, by parameter of the device, and of the variance, counts²;
    relative, but of offsets in counts"""
    faults: list[Fault] = field(default_factory=list)

    @property
    def good(self) -> Mask:
        """Usable pixels."""
        return self.captured.usable & self.expected.usable & ~self.masked

    @cached_property
    def light_hz(self) -> Floats:
        """Mean detection rates (rows, columns)."""
        return np.asarray(np.mean(self.rate_hz, axis=0, dtype=np.float64))

    @cached_property
    def parts(self) -> dict[str, Floats]:
        """Change of the mean counts (rows, columns) if a parameter changes by its own size.

        Of the step, by that of all counts; of an offset, by one count.
        """
        exposure_s, light_hz = self.expected.exposure_s, self.light_hz
        mean = self.model.moments(exposure_s, light_hz)[0]
        brighter, darker = (
            (self.model.moments(exposure_s, light_hz, parameter, _SMALL)[0] - mean) / _SMALL
            for parameter in ("efficiency", "dark counts")
        )
        offset = np.ones_like(mean)
        return {"step": mean, "efficiency": brighter, "dark counts": darker, "offset": offset}

    @property
    def standardized(self) -> Standardized:
        """Standardized readings."""
        return Standardized.of(self.captured.signal, self.good)

    @property
    def moving(self) -> str:
        """Parameter that a common fluctuation moves most probably."""
        if not self.captured.is_dark:
            return "efficiency"
        return "step" if self.captured.codes is None else "offset"

    def subtract(self, change: Floats | NDArray[np.float32]) -> None:
        """Subtract counts (n or 1, rows, columns) from the captured frames."""
        level = self.captured
        signal = np.asarray(level.signal - change, np.float32)
        if level.unrounded is None:
            self.captured = replace(level, readings=signal)
            return
        moved = np.rint(signal.clip(0)) - np.rint(np.asarray(level.unrounded).clip(0))
        readings = np.maximum(level.readings + moved, 0)
        self.captured = replace(level, unrounded=signal, readings=readings)

    def doubt(self, parameter: str, size: float) -> None:
        """Note a further uncertainty of a parameter."""
        self.uncertainty[parameter] = float(np.hypot(self.uncertainty.get(parameter, 0.0), size))

    def note(self, kind: str, text: str) -> None:
        """Note a fault."""
        self.faults.append(Fault(kind, text))
