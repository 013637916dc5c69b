"""Separate quantities of a device, by blocks of frames; quantities of a scene; spectra.

    gain          variance over mean of dark and dim counts: 1 where a count is an event
    crosstalk     neighbors fired per event: covariance over mean and gain
    dark counts   mean rate in the dark, in events, less those due to crosstalk
    efficiency    events per light, likewise, of dim frames less dark ones
    dead time     from the deficit of bright frames below the line through dim ones

Dividing by the gain separates a wrong step from light; dividing out crosstalk separates it from
efficiency.

A scene has no dark and no uniform light, so its quantities mix those of the device: brightness, and
contrast, the slope of counts over the light that the model expects, which dark counts do not
change. Both are computed and compared block by block, since the scene is the same in both.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.two_sample import Difference, Quantity, difference

BLOCKS = 20
SEGMENT = 32
"""Frames per segment of a spectrum."""
BANDS = 4
_BRIGHT = 4.0
"""Light, relative to the dimmest, above which a level determines the dead time."""
_BRIGHTNESS = Quantity("brightness", "counts per second")
_CONTRAST = Quantity("contrast", "counts per photon detected")


def block_quantities(
    levels: Sequence[Level], usable: Sequence[Mask], kind: str = "paralyzable"
) -> dict[str, Floats]:
    """Return quantities by name, each (blocks,), as far as the levels determine them.

    `usable` selects the pixels of each level, (rows, columns); `kind` is the kind of dead time,
    "paralyzable" or "nonparalyzable".
    """
    blocks = [_of_block(levels, usable, kind, at) for at in range(BLOCKS)]
    return {name: np.array([each[name] for each in blocks]) for name in blocks[0]}


def unsure_quantities(
    levels: Sequence[Level], usable: Sequence[Mask], errors: Sequence[Floats | float]
) -> dict[str, float]:
    """Return standard errors of quantities due to those of mean counts (rows, columns).

    Darkness and the dimmest light contribute; errors of pixels are independent.
    """
    found = {}
    for name, is_dark in (("dark counts", True), ("efficiency", False)):
        chosen = [at for at, level in enumerate(levels) if level.is_dark == is_dark]
        if chosen:
            at = min(chosen, key=lambda place: levels[place].light_hz)
            own = np.broadcast_to(errors[at], usable[at].shape)[usable[at]]
            scale = levels[at].exposure_s * (levels[at].light_hz or 1.0) * max(own.size, 1)
            found[name] = float(np.sqrt(np.square(own).sum())) / scale
    return found


def _of_block(
    levels: Sequence[Level], good: Sequence[Mask], kind: str, block: int
) -> dict[str, float]:
    own = [_block(level.readings, block) for level in levels]
    means = [each.mean(axis=0) for each in own]
    lights = [level.light_hz for level in levels]
    lit = sorted({light for light in lights if light})
    linear = [at for at, light in enumerate(lights) if light <= min(lit, default=0)]
    total = sum(float(means[at][good[at]].sum()) for at in linear)
    if total <= 0:
        return {}
    spread = sum(float(own[at].var(axis=0, ddof=1)[good[at]].sum()) for at in linear)
    gain = spread / total
    crosstalk = _crosstalk([(own[at] - means[at], means[at], good[at]) for at in linear]) / gain
    found = {"step": gain, "crosstalk": crosstalk}
    primary = (1 - crosstalk) / gain
    rate = [mean / level.exposure_s for mean, level in zip(means, levels, strict=True)]
    dark = [at for at, light in enumerate(lights) if not light]
    base = np.zeros_like(rate[0])
    if dark:
        every = np.logical_and.reduce([good[at] for at in dark])
        weights = [levels[at].exposure_s for at in dark]
        base = np.average([rate[at] for at in dark], axis=0, weights=weights)
        found["dark counts"] = float(base[every].mean()) * primary
    if lit:
        dim = lights.index(lit[0])
        signal = rate[dim] - base
        found["efficiency"] = float(signal[good[dim]].mean()) * primary / lit[0]
        losses = [
            _loss(rate[at], base + light / lit[0] * signal, good[at] & good[dim], gain)
            for at, light in enumerate(lights)
            if light >= _BRIGHT * lit[0]
        ]
        if losses:
            found["dead time"] = _dead_time_s(*max(losses, key=lambda each: each[1]), kind)
    return found


def _block(counts: NDArray[np.floating], block: int) -> Floats:
    edges = np.linspace(0, len(counts), BLOCKS + 1).astype(int)
    return np.asarray(counts[edges[block] : edges[block + 1]], np.float64)


def _loss(kept: Floats, offered: Floats, good: Mask, gain: float) -> tuple[float, float]:
    """Mean event rates, counted and without loss, Hz."""
    if not good.any():
        return 0.0, 0.0
    return float(kept[good].mean()) / gain, float(offered[good].mean()) / gain


def _dead_time_s(kept: float, offered: float, kind: str) -> float:
    if offered <= 0:
        return 0.0
    share = max(kept / offered, 1e-9)
    loss = -np.log(share) if kind == "paralyzable" else 1 / share - 1
    return float(loss / offered)


def _crosstalk(levels: Sequence[tuple[Floats, Floats, Mask]]) -> float:
    """Mean number of neighbors that an event fires, times the gain.

    `levels` holds deviations of counts, their means and good pixels of each level.
    """
    together = total = 0.0
    pixels = pairs = 0
    whole, but_last, but_first = slice(None), slice(None, -1), slice(1, None)
    for deviations, mean, good in levels:
        apart = np.where(good, deviations, 0)
        for first, second in (
            ((whole, but_last), (whole, but_first)),
            ((but_last, whole), (but_first, whole)),
        ):
            both = good[first] & good[second]
            together += float((apart[:, *first] * apart[:, *second]).sum()) / (len(apart) - 1)
            total += float((mean[first] + mean[second])[both].sum())
            pairs += int(both.sum())
        pixels += int(good.sum())
    if not pairs or total <= 0:
        return 0.0
    return together / total * (2 * pairs / pixels)


def scene_differences(
    captured: Level,
    expected: Level,
    light_hz: Floats,
    margin: float,
    errors_hz: Floats | float = 0.0,
) -> tuple[Difference, ...]:
    """Compare brightness and contrast, frame by frame, of the same scene.

    `light_hz` (n, rows, columns): the model's detection rate of always-live pixels; `margin`:
    negligible relative difference; `errors_hz` (rows, columns) or float: standard errors of
    expected rates that come from a calibration.
    """
    good = captured.usable & expected.usable
    blocks = np.array_split(np.arange(len(light_hz)), BLOCKS)
    light = light_hz[:, good]
    own = np.broadcast_to(errors_hz, good.shape)[good]
    unsure = float(np.sqrt(np.square(own).sum())) / max(own.size, 1)
    measures = [(_BRIGHTNESS, unsure, _mean)]
    if light.std() > 1e-6 * light.mean():
        measures.append((_CONTRAST, 0.0, _slope))
    found = []
    for quantity, error, measure in measures:
        a, b = (
            np.array([measure(each.readings[at][:, good], light[at]) for at in blocks])
            / each.exposure_s
            for each in (captured, expected)
        )
        typical = np.full(BLOCKS, b.mean())
        found.append(difference(quantity, a - b + typical, typical, margin, error))
    return tuple(found)


def _mean(counts: Floats, light: Floats) -> float:
    return float(counts.mean())


def _slope(counts: Floats, light: Floats) -> float:
    """Slope of counts over light, by least squares."""
    apart = light - light.mean()
    return float((apart * counts).sum() / max((apart**2).sum(), 1e-300))


def band_powers(counts: NDArray[np.floating]) -> Floats:
    """Return each band's share of the power in segments of frames, (segments, BANDS).

    White noise has the same power in each of the `SEGMENT`/2 frequencies.
    """
    segments = len(counts) // SEGMENT
    if segments < 2:
        return np.empty((0, BANDS))
    power = segment_spectra(counts)[:, 1:]
    bands = np.add.reduceat(power, np.linspace(0, SEGMENT // 2, BANDS + 1).astype(int)[:-1], axis=1)
    return np.asarray(bands / np.maximum(bands.sum(axis=1, keepdims=True), 1e-300))


def segment_spectra(counts: NDArray[np.floating]) -> Floats:
    """Return the power over frequency of segments of frames, (segments, SEGMENT/2 + 1).

    Mean over the pixels.
    """
    segments = len(counts) // SEGMENT
    pieces = np.asarray(counts[: segments * SEGMENT], np.float64).reshape(segments, SEGMENT, -1)
    transform = np.fft.rfft(pieces - pieces.mean(axis=1, keepdims=True), axis=1)
    return np.asarray(np.square(np.abs(transform)).mean(axis=-1) / SEGMENT)
