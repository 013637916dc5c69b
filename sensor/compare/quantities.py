"""Counts of frames that were taken alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.compare.two_sample import Difference, difference


@dataclass(frozen=True, eq=False)
class CountedFrames:
    """Counts at one light and exposure."""

    counts: NDArray[Any]
    """(n, rows, columns)"""
    exposure_s: float
    light_hz: float = 0.0
    """In the unit of the other levels; 0: in the dark"""
    saturated: NDArray[np.bool_] | None = None
    """(n, rows, columns) counts that are lower bounds"""
    times_s: NDArray[np.float64] | None = None
    """(n,) when each exposure began; one after the other where it is not known"""

    @property
    def is_dark(self) -> bool:
        """Whether there was no light."""
        return self.light_hz == 0

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Pixels (rows, columns) that are never full."""
        if self.saturated is None:
            return np.ones(self.counts.shape[1:], np.bool_)
        return np.asarray(~self.saturated.any(axis=0))


BLOCKS = 20
_BRIGHT = 4.0
"""Times the dimmest light from which on a level tells the dead time."""


def block_quantities(
    levels: Sequence[CountedFrames], usable: Sequence[Mask], kind: str = "paralyzable"
) -> dict[str, Floats]:
    """Return quantities by name, each (blocks,), as far as the levels tell them.

    Parameters
    ----------
    levels : sequence of CountedFrames
    usable : sequence of (rows, columns) bool
        Pixels of each level that are used.
    kind : "paralyzable" or "nonparalyzable"
        Of the dead time.
    """
    blocks = [_of_block(levels, usable, kind, at) for at in range(BLOCKS)]
    return {name: np.array([each[name] for each in blocks]) for name in blocks[0]}


def unsure_quantities(
    levels: Sequence[CountedFrames], usable: Sequence[Mask], errors: Sequence[Floats | float]
) -> dict[str, float]:
    """Return standard errors of quantities that those of mean counts (rows, columns) make.

    They are of darkness and of the dimmest light; errors of pixels are independent of each other.
    """
    found = {}
    for name, chosen in (
        ("dark counts", [at for at, level in enumerate(levels) if level.is_dark]),
        ("efficiency", [at for at, level in enumerate(levels) if not level.is_dark]),
    ):
        if chosen:
            at = min(chosen, key=lambda place: levels[place].light_hz)
            own = np.broadcast_to(errors[at], usable[at].shape)[usable[at]]
            scale = levels[at].exposure_s * (levels[at].light_hz or 1.0) * max(own.size, 1)
            found[name] = float(np.sqrt(np.square(own).sum())) / scale
    return found


def _of_block(
    levels: Sequence[CountedFrames], usable: Sequence[Mask], kind: str, block: int
) -> dict[str, float]:
    own = [_block(level.counts, block) for level in levels]
    lit = sorted({level.light_hz for level in levels if not level.is_dark})
    linear = [at for at, level in enumerate(levels) if level.light_hz <= min(lit, default=0)]
    means = [each.mean(axis=0) for each in own]
    good = usable
    found: dict[str, float] = {}
    total = sum(float(means[at][good[at]].sum()) for at in linear)
    if total <= 0:
        return found
    spread = sum(float(own[at].var(axis=0, ddof=1)[good[at]].sum()) for at in linear)
    found["step"] = gain = spread / total
    found["crosstalk"] = crosstalk = _crosstalk(own, means, good, linear) / gain
    primary = (1 - crosstalk) / gain
    dark = [at for at, level in enumerate(levels) if level.is_dark]
    rate = _rates(levels, means)
    dark_rate = None
    if dark:
        every = np.logical_and.reduce([good[at] for at in dark])
        weights = [levels[at].exposure_s for at in dark]
        dark_rate = np.average([rate[at] for at in dark], axis=0, weights=weights)
        found["dark counts"] = float(dark_rate[every].mean()) * primary
    if lit:
        dim = next(at for at, level in enumerate(levels) if level.light_hz == lit[0])
        base = dark_rate if dark_rate is not None else np.zeros_like(rate[dim])
        signal = rate[dim] - base
        found["efficiency"] = float(signal[good[dim]].mean()) * primary / lit[0]
        bright = [at for at, level in enumerate(levels) if level.light_hz >= _BRIGHT * lit[0]]
        if bright:
            losses = [
                _loss(
                    rate[at], base, signal, levels[at].light_hz / lit[0], good[at] & good[dim], gain
                )
                for at in bright
            ]
            kept, offered = max(losses, key=lambda each: each[1])
            share = max(kept / offered, 1e-9) if offered > 0 else 1.0
            loss = -np.log(share) if kind == "paralyzable" else 1 / share - 1
            found["dead time"] = float(loss / offered) if offered > 0 else 0.0
    return found


def _block(counts: NDArray[np.floating], block: int) -> Floats:
    edges = np.linspace(0, len(counts), BLOCKS + 1).astype(int)
    return np.asarray(counts[edges[block] : edges[block + 1]], np.float64)


def _rates(levels: Sequence[CountedFrames], means: Sequence[Floats]) -> list[Floats]:
    return [mean / level.exposure_s for mean, level in zip(means, levels, strict=True)]


def _loss(
    rate: Floats, base: Floats, signal: Floats, times: float, good: Mask, gain: float
) -> tuple[float, float]:
    """Mean rates in events: what is counted and what would be without loss, Hz."""
    if not good.any():
        return 0.0, 0.0
    return float(rate[good].mean()) / gain, float((base + times * signal)[good].mean()) / gain


def _crosstalk(
    own: Sequence[Floats], means: Sequence[Floats], good: Sequence[Mask], chosen: Sequence[int]
) -> float:
    """Mean number of neighbors that an event fires, times the gain."""
    together = total = 0.0
    pixels = pairs = 0
    for at in chosen:
        apart = np.where(good[at], own[at] - means[at], 0)
        n = len(apart) - 1
        for first, second in (
            ((slice(None), slice(None, -1)), (slice(None), slice(1, None))),
            ((slice(None, -1), slice(None)), (slice(1, None), slice(None))),
        ):
            both = good[at][first] & good[at][second]
            together += float((apart[:, *first] * apart[:, *second]).sum()) / n
            total += float((means[at][first] + means[at][second])[both].sum())
            pairs += int(both.sum())
        pixels += int(good[at].sum())
    if not pairs or total <= 0:
        return 0.0
    return together / total * (2 * pairs / pixels)


def scene_differences(
    captured: CountedFrames,
    expected: CountedFrames,
    light_hz: Floats,
    margin: float,
    errors_hz: Floats | float = 0.0,
) -> tuple[Difference, ...]:
    """Compare brightness and contrast.

    Parameters
    ----------
    captured, expected : CountedFrames
        Frame by frame of the same sight.
    light_hz : (n, rows, columns)
        What pixels detect of it in the model, were they always live.
    margin : float
        Relative difference that does not matter.
    errors_hz : (rows, columns) or float
        Standard errors of the expected rates, where these are a calibration's.
    """
    good = captured.usable & expected.usable
    blocks = np.array_split(np.arange(len(light_hz)), BLOCKS)
    light = light_hz[:, good]
    own = np.broadcast_to(errors_hz, good.shape)[good]
    unsure = float(np.sqrt(np.square(own).sum())) / max(own.size, 1)
    found = []
    for name, unit, value in (
        ("brightness", "counts per second", _brightness),
        ("contrast", "counts per photon detected", _contrast),
    ):
        if name == "contrast" and not light.std() > 1e-6 * light.mean():
            continue
        a, b = (
            np.array([value(each.counts[at][:, good], light[at]) for at in blocks])
            / each.exposure_s
            for each in (captured, expected)
        )
        typical = np.full(BLOCKS, b.mean())
        error = unsure if name == "brightness" else 0.0
        found.append(difference(name, a - b + typical, typical, unit, margin, unsure=error))
    return tuple(found)


def _brightness(counts: Floats, light: Floats) -> float:
    return float(counts.mean())


def _contrast(counts: Floats, light: Floats) -> float:
    apart = light - light.mean()
    return float((apart * counts).sum() / max((apart**2).sum(), 1e-300))


SEGMENT = 32
BANDS = 4


def band_powers(counts: NDArray[np.floating]) -> Floats:
    """Share of each band in the power of segments of frames, (segments, BANDS).

    White noise has the same power in each of the `SEGMENT`/2 frequencies.
    """
    segments = len(counts) // SEGMENT
    if segments < 2:
        return np.empty((0, BANDS))
    pieces = np.asarray(counts[: segments * SEGMENT], np.float64)
    pieces = pieces.reshape(segments, SEGMENT, -1)
    power = mean_spectrum(pieces)[:, 1:]
    bands = np.add.reduceat(power, np.linspace(0, SEGMENT // 2, BANDS + 1).astype(int)[:-1], axis=1)
    return np.asarray(bands / np.maximum(bands.sum(axis=1, keepdims=True), 1e-300))


def mean_spectrum(pieces: Floats) -> Floats:
    """Power over frequency (segments, SEGMENT/2 + 1), mean over the pixels of (…, SEGMENT, P)."""
    apart = pieces - pieces.mean(axis=-2, keepdims=True)
    transform = np.fft.rfft(apart, axis=-2)
    return np.asarray(np.square(np.abs(transform)).mean(axis=-1) / pieces.shape[-2])
