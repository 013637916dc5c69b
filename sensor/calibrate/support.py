"""What recordings must have so that a fit of them means something."""

from collections.abc import Sequence

import numpy as np

from megalopta.sensor.calibrate.level import Adc, Level

FEWEST_FRAMES = 50
FEWEST_DARK_EXPOSURES = 3
_DRIFT_Z = 6.0
_SMALLEST_DRIFT = 0.005
_DARKEST_Z = 6.0


def check_levels(levels: Sequence[Level], adc: Adc) -> None:
    """Refuse recordings that cannot tell a device.

    Raises
    ------
    ValueError
        When levels are of different arrays, have too few frames, drift or are saturated, when no
        exposures of the dark differ, or light makes no difference.
    """
    shapes = sorted({level.codes.shape[1:] for level in levels if level.codes.ndim == 3})
    if len(shapes) != 1 or any(level.codes.ndim != 3 for level in levels):
        raise ValueError(
            f"recordings of {', '.join(map(str, shapes)) or 'no'} pixels; give frames of one device"
        )
    for level in levels:
        if len(level.codes) < FEWEST_FRAMES:
            raise ValueError(f"{level}: {len(level.codes)} frames; capture {FEWEST_FRAMES} or more")
        _check_steadiness(level)
    dark = sorted({level.exposure_s for level in levels if level.is_dark})
    if len(dark) < FEWEST_DARK_EXPOSURES:
        raise ValueError(
            f"dark frames of {len(dark)} exposures; capture {FEWEST_DARK_EXPOSURES} or more, so "
            "that leak and dark counts can be told apart"
        )
    if all(np.median(level.codes) <= adc.bottom for level in levels):
        raise ValueError("all levels are saturated; expose for less or lower the light")
    _check_light(levels, adc)


def _check_steadiness(level: Level) -> None:
    totals = level.codes.mean(axis=(1, 2), dtype=np.float64)
    half = len(totals) // 2
    first, second = totals[:half], totals[half:]
    change = float(second.mean() - first.mean())
    error = float(np.sqrt(first.var(ddof=1) / first.size + second.var(ddof=1) / second.size))
    pixel = float(np.sqrt(level.codes.var(axis=0, dtype=np.float64).mean()))
    if abs(change) > _DRIFT_Z * error and abs(change) > max(_SMALLEST_DRIFT * pixel, 0.05):
        raise ValueError(
            f"{level}: it drifts, the second half differs from the first by {change:.3g} codes, "
            f"{abs(change) / max(error, 1e-12):.0f} standard errors; let light and temperature "
            "settle and capture again"
        )


def _check_light(levels: Sequence[Level], adc: Adc) -> None:
    lit = [level for level in levels if not level.is_dark]
    if not lit:
        return
    if all(np.median(level.codes) <= adc.bottom for level in lit):
        raise ValueError("flat frames are saturated; expose for less or lower the light")
    rates = {
        is_dark: max(
            (adc.top - float(level.codes.mean())) / level.exposure_s
            for level in levels
            if level.is_dark == is_dark and np.median(level.codes) > adc.bottom
        )
        for is_dark in (True, False)
    }
    brightest = min(lit, key=lambda level: float(level.codes.mean()))
    frames = brightest.codes
    spread = float(frames.mean(axis=(1, 2)).std(ddof=1)) / np.sqrt(len(frames))
    excess = (rates[False] - rates[True]) * brightest.exposure_s
    if excess < _DARKEST_Z * spread:
        raise ValueError(
            f"{brightest}: no brighter than the dark; uncover the sensor or raise the light"
        )
