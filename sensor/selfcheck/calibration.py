"""What calibration makes of dark and flat frames, against what they were drawn from."""

from collections.abc import Iterator

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor import changed, preset
from megalopta.sensor.correct import calibrate, hot_pixels
from megalopta.sensor.counters import DigitalCounter
from megalopta.sensor.selfcheck.comparison import Row, exact_row

_IDEAL = preset("ideal")
_SIDE = 200


def check_calibration() -> Iterator[Row]:
    """Dark and gain of many pixels, from twenty frames each by NumPy."""
    rng, frames, even = np.random.default_rng(31), 20, 400.0
    shape = _SIDE, _SIDE
    gain = rng.uniform(0.7, 1.3, shape)
    dark = rng.uniform(20.0, 60.0, shape)
    darks, flats = (rng.poisson(mean, (frames, *shape)) for mean in (dark, dark + even * gain))
    found = calibrate(darks, flats, _IDEAL, flat_detections=even)
    yield from _estimate_rows("calibrated dark", found.dark - dark, found.dark_variance)
    yield from _estimate_rows("calibrated gain", found.gain - gain, found.gain_variance)
    relative = calibrate(darks, flats, _IDEAL).gain
    off = float(np.abs(relative / found.gain * found.gain.mean() - 1).max())
    yield exact_row("calibrated gain", "mean, of no known light", 1, float(relative.mean()), 1e-9)
    yield exact_row("calibrated gain", "largest change by that", 0, off, 1e-9)


def check_bad_pixels() -> Iterator[Row]:
    """Pixels that are hot, dead or nearly full, among others that are close to it."""
    rng, even = np.random.default_rng(34), 400.0
    hot = rng.uniform(20.0, 60.0, (_SIDE, _SIDE))
    hot[::10, ::10] *= 12.6  # from 252 to 756, where ten times the median is near 400
    limit = 10 * float(np.median(hot))
    share = float(hot_pixels(hot, 10.0).mean())
    yield exact_row("hot pixels", "share", float((hot > limit).mean()), share, 1e-9)
    dead = rng.uniform(0.7, 1.3, (_SIDE, _SIDE))
    dead[::10, ::10] = np.linspace(0.05, 0.35, 400).reshape(20, 20)
    expected = float((dead < 0.2 * np.median(dead)).mean())
    yield exact_row("dead pixels", "share", expected, _bad_share(even * dead, 100_000), 1e-9)
    # a counter that reads the light up to its last step
    full = rng.uniform(0.4, 0.6, (_SIDE, _SIDE))
    full[::10, ::10] = np.linspace(0.8, 1.0, 400).reshape(20, 20)
    expected = float((full >= 0.95).mean())
    yield exact_row("full pixels", "share", expected, _bad_share(10_000 * full, 10_000), 1e-4)


def _bad_share(flat: Floats, capacity: int) -> float:
    """Share of the pixels that are marked when frames without noise tell of this light."""
    sensor = changed(_IDEAL, counter=DigitalCounter(capacity=capacity))
    found = calibrate(np.zeros((2, *flat.shape)), np.broadcast_to(flat, (2, *flat.shape)), sensor)
    return float(found.bad.mean())


def _estimate_rows(term: str, error: Floats, variance: Floats) -> Iterator[Row]:
    """Errors of independent estimates: no mean, and the variance that is stated."""
    sigma = float(np.sqrt(variance.mean() / error.size))
    z = float(error.mean()) / sigma
    yield Row(term, "mean error", 0.0, float(error.mean()), z)
    # squares of errors, and variances that are estimates themselves
    excess = error**2 - variance
    z = float(excess.mean() / (excess.std() / excess.size**0.5))
    stated, found = float(variance.mean()), float((error**2).mean())
    yield Row(term, "variance of the estimate", stated, found, z)
