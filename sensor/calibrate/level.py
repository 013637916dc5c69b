"""Recorded readings at one light level and exposure: requirements and photon transfer.

**Photon transfer**: a counter's step from the growth of the variance of readings with their mean.

Poisson events of step s on an output of offset a, leak l and read noise r make

    mean = a + l·T + s·λ      variance = r² + s²·λ = r² + s·(mean − a − l·T)

so the slope of variance over mean is the step. No comb is needed. Neglecting the leak makes the
step too small by the leak relative to the dark counts, l/(s·d): 0.3 % for SPADCAM. In the dark,
mean and exposure grow together, so the data hardly determine the leak. Only dim levels are used,
where dead time does not yet make the counts sub-Poisson.

**Drift**: the second half of a recording against the first. It is refused where it is more than
chance and more than 0.5 % of a pixel's noise. Below that, its covariance is below 1e-5 of a pixel's
variance, too small to look like crosstalk, and means of up to 40,000 frames change by less than
their standard errors.

Source: EMVA 1288 release 4, Linear.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.core.quantities import short, with_error
from megalopta.sensor.spad.counters import AnalogCounter

_FEWEST_FRAMES = 50
_FEWEST_DARK_EXPOSURES = 3


@dataclass(frozen=True, eq=False)
class Level:
    """Frames taken under the same conditions."""

    readings: NDArray[Any]
    """(n, rows, columns) counts, or codes of the ADC, lower for more counts"""
    exposure_s: float
    light_hz: float = 0.0
    """Photons per second on a pixel, or any unit that all levels share; 0: dark"""
    saturated: NDArray[np.bool_] | None = None
    """(n, rows, columns) readings that are lower bounds"""
    times_s: Floats | None = None
    """(n,) start of each exposure; back to back if not known"""
    codes: NDArray[np.uint16] | None = None
    """(n, rows, columns) codes of the ADC behind counts"""
    unrounded: NDArray[np.float32] | None = None
    """(n, rows, columns) counts of these codes before rounding; below 0 by noise"""

    @property
    def is_dark(self) -> bool:
        """True for a dark level."""
        return self.light_hz == 0

    @property
    def recorded(self) -> NDArray[Any]:
        """Frames as recorded, codes or counts."""
        return self.readings if self.codes is None else self.codes

    @property
    def signal(self) -> NDArray[Any]:
        """Counts, from codes before rounding."""
        return self.readings if self.unrounded is None else self.unrounded

    @property
    def interval_s(self) -> float:
        """Time between frames, s; the exposure if times are not known."""
        if self.times_s is None or len(self.times_s) < 2:
            return self.exposure_s
        return float(np.median(np.diff(self.times_s)))

    def at(self, frames: NDArray[Any] | slice) -> "Level":
        """Keep some frames, (n,) mask or numbers, or a slice."""
        times_s = None if self.times_s is None else self.times_s[frames]
        return replace(self.mapped(lambda values: values[frames]), times_s=times_s)

    def mapped(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> "Level":
        """Change each array of frames (n, rows, columns) alike."""
        arrays: dict[str, Any] = {
            name: change(frames)
            for name in ("readings", "saturated", "codes", "unrounded")
            if (frames := getattr(self, name)) is not None
        }
        return replace(self, **arrays)

    def moved(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> "Level":
        """Change counts, and leave codes as they are."""
        signal = np.asarray(change(np.asarray(self.signal, np.float32)), np.float32)
        if self.unrounded is None:
            return replace(self, readings=signal)
        return replace(self, unrounded=signal, readings=np.rint(signal.clip(0)))

    @property
    def usable(self) -> Mask:
        """Pixels (rows, columns) that are never saturated."""
        if self.saturated is None:
            return np.ones(self.readings.shape[1:], np.bool_)
        return np.asarray(~self.saturated.any(axis=0))

    def __str__(self) -> str:
        return conditions(self.light_hz, self.exposure_s)


def conditions(light_hz: float, exposure_s: float) -> str:
    """Return how a recording was taken, as text."""
    light = f"light of {short(light_hz)}" if light_hz else "dark"
    return f"{light}, exposure of {with_error(exposure_s, 0, 's')}"


def check_steadiness(recording: object, frame_means: Floats, variance: Floats) -> None:
    """Refuse a recording that drifts; ValueError names it.

    `frame_means` (n,), of independent frames, and the variance of each pixel.
    """
    first, second = np.split(frame_means, [len(frame_means) // 2])
    change, sigma = float(second.mean() - first.mean()), float(np.sqrt(variance.mean()))
    error = np.sqrt(first.var(ddof=1) / first.size + second.var(ddof=1) / second.size)
    if abs(change) > max(6.0 * error, 0.005 * sigma):
        raise ValueError(
            f"{recording}: drifts; the second half differs from the first by "
            f"{change / max(sigma, 1e-300):+.2g} times the noise of a pixel, "
            f"{abs(change) / max(error, 1e-300):.0f} standard errors; let light and temperature "
            "settle and capture again"
        )


class Drops(NamedTuple):
    """Voltage drops of outputs by level and pixel.

    Entries are (E,), one for each drop that a pixel shows at a level; maps are (levels, pixels).
    """

    level: Ints
    pixel: Ints
    drop_v: Floats
    times: Floats
    """Number of frames with this drop"""
    frames: Floats
    """0 where a pixel came near its bottom and is excluded."""
    mean_v: Floats
    variance_v2: Floats
    exposure_s: Floats
    """(levels,)"""
    light_hz: Floats
    """(levels,)"""
    is_cut: bool
    """True if any output was above the range of the ADC: noise of readings of no counts is
    clipped."""

    def at(self, entries: Mask) -> "Drops":
        """Keep some entries, (E,)."""
        return self._replace(**{name: getattr(self, name)[entries] for name in self._fields[:4]})

    @property
    def entry_exposure_s(self) -> Floats:
        """Exposure of each entry, (E,)."""
        return self.exposure_s[self.level]

    def sums(self, values: Floats) -> Floats:
        """Return sums of values (k, E) over the readings of each pixel, (P,)."""
        weights = self.times * values.sum(axis=0)
        return np.bincount(self.pixel, weights, self.frames.shape[1]).astype(np.float64)

    def normal_matrix(self, weights: Floats, columns: Sequence[Floats]) -> Floats:
        """Return the matrix of the normal equations of each pixel; weights, columns (k, E)."""
        normal = np.empty((self.frames.shape[1], len(columns), len(columns)))
        for row, first in enumerate(columns):
            for column, second in enumerate(columns[: row + 1]):
                product = self.sums(weights * first * second)
                normal[:, row, column] = normal[:, column, row] = product
        return normal


def drops_of(levels: Sequence[Level], counter: AnalogCounter) -> Drops:
    """Return the voltage drops, without pixels near their bottom at a level."""
    pixels = levels[0].readings[0].size
    top = counter.supply_v / counter.lsb_v
    # offsets move the bottom, too
    lowest = top - 0.95 * counter.swing_v / counter.lsb_v
    entries, maps = [], []
    for number, level in enumerate(levels):
        codes = level.readings.reshape(len(level.readings), pixels)
        mean, variance = codes.mean(axis=0), codes.var(axis=0, ddof=1)
        is_usable = mean - 6.0 * np.sqrt(variance) > lowest
        maps.append((np.where(is_usable, len(codes), 0), mean, variance))
        least, size = int(codes.min()), int(np.ptp(codes)) + 1
        keys = (codes.astype(np.int64) - least) + size * np.arange(pixels)
        times = np.bincount(keys[:, is_usable].ravel(), minlength=pixels * size)
        key = np.flatnonzero(times)
        entries.append((np.full(key.size, number), key // size, key % size + least, times[key]))
    level_of, pixel, code, times = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    frames, mean, variance = np.array(list(zip(*maps, strict=True)), np.float64)
    exposure_s, light_hz = np.array([(level.exposure_s, level.light_hz) for level in levels]).T
    return Drops(
        level_of, pixel, (top - code) * counter.lsb_v, times.astype(float), frames,
        (top - mean) * counter.lsb_v, variance * counter.lsb_v**2, exposure_s, light_hz,
        is_cut=bool(code.max(initial=0) >= np.rint(top)),
    )  # fmt: skip


def check_levels(levels: Sequence[Level], counter: AnalogCounter) -> None:
    """Reject recordings that cannot determine a device.

    Raises ValueError if levels are of different arrays, have too few frames, drift or are
    saturated, if all dark exposures are equal, or if light has no effect.
    """
    shapes = sorted({level.readings.shape[1:] for level in levels})
    if len(shapes) != 1 or len(shapes[0]) != 2:
        raise ValueError(f"recordings of {shapes} pixels; give frames of one device")
    for level in levels:
        if len(level.readings) < _FEWEST_FRAMES:
            raise ValueError(
                f"{level}: {len(level.readings)} frames; capture {_FEWEST_FRAMES} or more"
            )
        frame_means = level.readings.mean(axis=(1, 2), dtype=np.float64)
        check_steadiness(level, frame_means, level.readings.var(axis=0, dtype=np.float64))
    dark = [level for level in levels if level.is_dark]
    lit = [level for level in levels if not level.is_dark]
    if (exposures := len({level.exposure_s for level in dark})) < _FEWEST_DARK_EXPOSURES:
        raise ValueError(
            f"dark frames of {exposures} exposures; capture {_FEWEST_DARK_EXPOSURES} or more, so "
            "that leak differs from dark counts"
        )
    # rates of codes, of levels that are not saturated
    top = counter.supply_v / counter.lsb_v
    dark_hz, lit_hz = (
        [
            (top - float(level.readings.mean())) / level.exposure_s
            for level in kind
            if np.median(level.readings) > top - counter.swing_v / counter.lsb_v
        ]
        for kind in (dark, lit)
    )
    if not dark_hz or (lit and not lit_hz):
        raise ValueError("dark or flat frames are saturated; expose for less or lower the light")
    if not lit:
        return
    brightest = min(lit, key=lambda level: float(level.readings.mean()))
    frame_means = brightest.readings.mean(axis=(1, 2))
    error = float(frame_means.std(ddof=1)) / np.sqrt(len(frame_means))
    if (max(lit_hz) - max(dark_hz)) * brightest.exposure_s < 6.0 * error:
        raise ValueError(
            f"{brightest}: no brighter than the dark; uncover the sensor or raise the light"
        )


class PhotonTransfer(NamedTuple):
    """Photon transfer line of each pixel, (P,)."""

    step_v: Floats
    step_error_v: Floats
    read_variance_v2: Floats
    offset_v: Floats
    """Voltage drop without counts at zero exposure (V)."""
    offset_error_v: Floats


def photon_transfer(drops: Drops) -> PhotonTransfer:
    """Fit variance over mean, and mean over exposure in the dark."""
    light_hz = drops.light_hz
    is_dim = light_hz <= 3.0 * light_hz[light_hz > 0].min(initial=np.inf)
    used = (drops.frames > 0) & is_dim[:, None] & (drops.mean_v >= 0)
    # voltage drop at zero exposure in the dark
    variance = drops.variance_v2 / np.maximum(drops.frames, 1) + 1e-18
    precision = np.where(used & (light_hz == 0)[:, None], 1 / variance, 0)
    ones = np.ones_like(drops.mean_v)
    exposure = ones * (drops.exposure_s / drops.exposure_s.max())[:, None]
    line, covariance = _weighted_fits([ones, exposure], drops.mean_v, precision)
    offset, offset_error = line[:, 0], np.sqrt(covariance[:, 0, 0])
    # variance over mean, in units of the largest mean
    size = np.abs(drops.mean_v - offset).max(axis=0) + 1e-30
    columns = [ones, (drops.mean_v - offset) / size]
    floor = 1e-3 * float(np.median(drops.variance_v2)) + 1e-18
    expected = np.maximum(drops.variance_v2, floor)
    for _ in range(6):
        weight = np.where(used, (np.maximum(drops.frames, 2) - 1) / (2 * expected**2), 0)
        line, covariance = _weighted_fits(columns, drops.variance_v2, weight)
        read, step = line.T
        expected = np.maximum(columns[0] * read + columns[1] * step, floor)
    step_error = np.sqrt(covariance[:, 1, 1]) / size
    return PhotonTransfer(step / size, step_error, read.clip(0), offset, offset_error)


def _weighted_fits(
    columns: Sequence[Floats], values: Floats, weight: Floats
) -> tuple[Floats, Floats]:
    """Fit combinations of columns to values, (levels, P) each; return (P, k) and (P, k, k)."""
    design = np.stack(columns, axis=-1)
    normal = np.einsum("lp,lpi,lpj->pij", weight, design, design)
    right = np.einsum("lp,lpi,lp->pi", weight, design, values)
    covariance = np.linalg.pinv(normal, hermitian=True)
    return np.einsum("pij,pj->pi", covariance, right), covariance


def unit_diagonal(matrices: Floats) -> tuple[Floats, Floats]:
    """Return symmetric matrices (…, k, k) scaled to a unit diagonal, and the factors (…, k)."""
    size = np.sqrt(np.maximum(np.diagonal(matrices, axis1=-2, axis2=-1), 0))
    factor = np.divide(1, size, out=np.zeros_like(size), where=size > 1e-150)
    return matrices * factor[..., :, None] * factor[..., None, :], factor


def inverses(matrices: Floats, smallest: float = 1e-15) -> Floats:
    """Return pseudoinverses of symmetric matrices (…, k, k) whose entries have different units.

    Eigenvalues below `smallest` of the largest, at a unit diagonal, are taken as 0.
    """
    unit, factor = unit_diagonal(matrices)
    inverse = np.linalg.pinv(unit, rcond=smallest, hermitian=True)
    return np.asarray(inverse * factor[..., :, None] * factor[..., None, :])
