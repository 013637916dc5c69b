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
from megalopta.sensor.compare.model import Change, Model, Parts, Uncertainty, Varying

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
        sums, pixels = self.z.sum(axis=2), self.varies.sum(axis=1)
        products, pairs = np.zeros(len(sums)), 0.0
        for row in range(sums.shape[1] - _FAR):
            products += sums[:, row] * sums[:, row + _FAR :].sum(axis=1)
            pairs += float(pixels[row] * pixels[row + _FAR :].sum())
        return _mean_and_error(products, pairs)

    def line_correlation(self, name: str) -> tuple[float, float]:
        """Return the mean correlation of pixels of one "row" or "column", four or more apart."""
        z = self.z if name == "row" else self.z.swapaxes(1, 2)
        varies = (self.varies if name == "row" else self.varies.T).astype(float)
        if z.shape[2] <= _FAR:
            return 0.0, np.inf
        later = np.cumsum(z[:, :, ::-1], axis=2)[:, :, ::-1]
        number = np.cumsum(varies[:, ::-1], axis=1)[:, ::-1]
        products = (z[:, :, :-_FAR] * later[:, :, _FAR:]).sum(axis=(1, 2))
        return _mean_and_error(products, float((varies[:, :-_FAR] * number[:, _FAR:]).sum()))


def _mean_and_error(products: Floats, pairs: float) -> tuple[float, float]:
    if not pairs:
        return 0.0, np.inf
    values = products / pairs
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
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
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
    def parts(self) -> Parts:
        """Expected counts, and their derivatives."""
        exposure_s = self.expected.exposure_s
        mean, brighter, darker = (
            self.model.moments(exposure_s, self.light_hz, change)[0]
            for change in (Change(), Change(efficiency=_SMALL), Change(dark_counts=_SMALL))
        )
        return Parts(mean, (brighter - mean) / _SMALL, (darker - mean) / _SMALL)

    @property
    def standardized(self) -> Standardized:
        """Standardized readings."""
        return Standardized.of(self.captured.signal, self.good)

    @property
    def moving(self) -> Varying:
        """Light or the output, which a common fluctuation moves most probably."""
        if not self.captured.is_dark:
            return Varying.LIGHT
        return Varying.GAIN if self.captured.codes is None else Varying.OFFSET

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

    def note(self, kind: str, text: str) -> None:
        """Note a fault."""
        self.faults.append(Fault(kind, text))
