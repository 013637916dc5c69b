"""One level in the course of a comparison, and its standardized readings.

Readings of a pixel are standardized, z = (x − mean)/σ, so that no bright or noisy pixel dominates.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.faults import Fault
from megalopta.sensor.compare.model import Model, level_of_codes

_FAR = 4
_SMALL = 0.01
LEAK_HZ = 100.0
"""Detections of light that leaks in, to which leaks are relative, Hz."""


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
    changes: dict[str, float] = field(default_factory=dict)
    """Parameters of the device that explain a difference, as of `Model.draw`"""
    quiet: set[str] = field(default_factory=set)
    """Statistics that are not tested, by the words that they begin with"""
    inflation: float = 1.0
    """Variance of means over that of independent frames"""
    faults: list[Fault] = field(default_factory=list)
    readout: list[Callable[[NDArray[Any]], NDArray[Any]]] = field(default_factory=list)
    """What the captured readout does to readings, codes or counts, and so to the expected ones"""

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

        Of the step, by that of all counts; of an offset, by one count; of a leak, by `LEAK_HZ`.
        """
        exposure_s, light_hz = self.expected.exposure_s, self.light_hz
        mean = self.model.moments(exposure_s, light_hz)[0]
        leak_hz = LEAK_HZ
        brighter, darker, leaking = (
            (self.model.moments(exposure_s, light_hz, parameter, _SMALL * size)[0] - mean) / _SMALL
            for parameter, size in (("efficiency", 1), ("dark counts", 1), ("light leak", leak_hz))
        )
        return {
            "step": mean,
            "efficiency": brighter,
            "dark counts": darker,
            "offset": np.ones_like(mean),
            "light leak": leaking,
        }

    @property
    def expected_mean(self) -> Floats:
        """Expected mean readings, (rows, columns)."""
        return _moments(self.expected)[0]

    @property
    def expected_sigma(self) -> Floats:
        """Expected σ of readings (rows, columns), at least that of an event in all frames."""
        return _moments(self.expected)[1]

    @property
    def numbers(self) -> Ints:
        """Number of each captured frame, counting lost ones, (n,)."""
        times_s, n = self.captured.times_s, len(self.captured.readings)
        if times_s is None or n < 2:
            return np.arange(n)
        timed = np.rint((times_s - times_s[0]) / self.captured.interval_s).astype(np.int64)
        # not if most are lost
        return timed if (np.diff(timed) > 0).all() and timed[-1] < 4 * n else np.arange(n)

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
        self.quiet.add("bit")
        self.captured = self.captured.moved(lambda counts: counts - change)

    def reorder(self, undone: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
        """Put captured pixels in another order; codes are those of the steps at their new place."""
        frames = self.captured
        if frames.codes is None:
            self.captured = frames.mapped(undone)
            return
        self.captured = self._of_codes(undone(frames.codes), frames)

    def keep(self, frames: Mask) -> None:
        """Keep some captured frames, (n,)."""
        self.captured = self.captured.at(frames)

    def redraw(self, seed: int, **changes: float) -> None:
        """Draw the expected frames of a device changed further, or of changed light."""
        self.__dict__.pop("light_hz", None)
        self.__dict__.pop("parts", None)
        self.changes = self.changes | changes
        self.expected = self.model.draw(self.expected, self.rate_hz, seed, "again, ", self.changes)
        readout, self.readout = self.readout, []
        for spoil in readout:
            self.read_out(spoil)

    def read_out(self, spoil: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
        """Do to the expected readings what the captured readout does."""
        self.readout.append(spoil)
        self.expected = self.spoiled(spoil)

    def spoiled(self, spoil: Callable[[NDArray[Any]], NDArray[Any]]) -> Level:
        """Return the expected frames after a change of their readings, codes or counts."""
        known = self.expected
        if known.codes is None:
            readings = np.rint(known.readings).astype(np.int64)
            return replace(known, readings=np.asarray(spoil(readings), known.readings.dtype))
        codes = np.asarray(spoil(known.codes), known.codes.dtype)
        return self._of_codes(codes, known)

    def _of_codes(self, codes: NDArray[Any], like: Level) -> Level:
        """Counts of codes that were read under the conditions of a level."""
        conditions = like.exposure_s, like.light_hz, like.times_s
        return level_of_codes(codes, self.model.sensor, *conditions)

    def doubts(self, kind: str) -> float:
        """Return what is uncertain of the mean z of all good pixels, or of a mean product."""
        good, sigma = self.good, np.maximum(self.expected_sigma, 1e-6)
        if kind != "mean":
            known = float(np.square(self.error[good] / sigma[good] ** 2).sum()) ** 0.5
            doubted = self.uncertainty.get("variance", 0.0) / float(np.square(sigma[good]).mean())
            moved_ = [
                self.uncertainty.get(name, 0.0) for name in ("efficiency", "dark counts", "step")
            ]
            return float(np.hypot(np.hypot(known / max(good.sum(), 1), doubted), max(moved_)))
        moved = [
            size * self.parts[name] / sigma
            for name, size in self.uncertainty.items()
            if name in self.parts
        ]
        doubted = float(np.square([shift[good].mean() for shift in moved]).sum()) ** 0.5
        # what the errors of a calibration do to the mean of so many pixels
        known = float(np.square((self.error / sigma)[good]).sum()) ** 0.5 / max(good.sum(), 1)
        return float(np.hypot(doubted, known))

    @property
    def doubted(self) -> Floats:
        """Return the uncertainty of the means of pixels, counts (rows, columns)."""
        squares = np.zeros(self.masked.shape)
        for name, size in self.uncertainty.items():
            if name in self.parts:
                squares += np.square(size * self.parts[name])
        return np.asarray(np.sqrt(squares))

    def doubt(self, parameter: str, size: float) -> None:
        """Note a further uncertainty of a parameter."""
        self.uncertainty[parameter] = float(np.hypot(self.uncertainty.get(parameter, 0.0), size))

    def note(self, kind: str, text: str) -> None:
        """Note a fault."""
        self.faults.append(Fault(kind, text))


@lru_cache(maxsize=32)
def _moments(level: Level) -> tuple[Floats, Floats]:
    """Mean and σ of readings, (rows, columns)."""
    mean = np.asarray(level.signal.mean(axis=0, dtype=np.float64))
    sigma = np.asarray(level.signal, np.float32).std(axis=0)
    return mean, np.maximum(sigma, len(level.readings) ** -0.5).astype(np.float64)
