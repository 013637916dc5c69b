"""Corrected frames against the light they were drawn from, and each step of the correction."""

from collections.abc import Iterator

import numpy as np
from scipy.special import gammainc

from megalopta.sensor import changed
from megalopta.sensor.correct import (
    Calibration,
    ResponseCurve,
    correct,
    filled_in,
    response_curve,
    simulated_calibration,
)
from megalopta.sensor.counters import DigitalCounter
from megalopta.sensor.effects import DeadTime
from megalopta.sensor.selfcheck.comparison import Row, exact_row
from megalopta.sensor.spad import Sensor, draw_fixed_pattern, expose_rate, preset, reading_moments

_IDEAL = preset("ideal")
_NONPARALYZABLE = changed(
    _IDEAL,
    dead_time=DeadTime(kind="nonparalyzable", dead_time_s=1e-3),
    counter=DigitalCounter(capacity=90),
)
_PARALYZABLE = changed(_IDEAL, dead_time=DeadTime(kind="paralyzable", dead_time_s=1e-3))
_SHAPE, _FRAMES = (16, 16), 400
_MEAN_TOLERANCE, _VARIANCE_TOLERANCE = 0.005, 0.05


def check_correction() -> Iterator[Row]:
    """Frames of a half and of 80 % of the largest reading, corrected."""
    for sensor in (preset("spadcam"), _NONPARALYZABLE, _PARALYZABLE):
        term = "corrected, " + (sensor.dead_time.kind if sensor.name == "ideal" else sensor.name)
        calibration = simulated_calibration(sensor, _SHAPE, frames=1600)
        for share in (0.5, 0.8):
            yield from _corrected_rows(f"{term}, {share:.0%}", sensor, calibration, share)


def check_propagation() -> Iterator[Row]:
    """Variance of corrected pixels where reading, dark and gain are all random: Monte Carlo."""
    rng, draws = np.random.default_rng(32), 200_000
    reading, dark, gain, errors = 90.0, 12.0, 1.6, (3.0, 1.5, 0.03)
    drawn = [
        rng.normal(center, sigma, draws)
        for center, sigma in zip((reading, dark, gain), errors, strict=True)
    ]
    sample = (drawn[0] - drawn[1]) / drawn[2]
    scale = np.linspace(0.0, 200.0, 41)
    line = ResponseCurve(scale, scale, np.full(scale.size, errors[0] ** 2), np.inf)
    a, b, c, d = (np.full((1, 1), each) for each in (dark, errors[1] ** 2, gain, errors[2] ** 2))
    device = Calibration(line, a, b, c, d, np.zeros((1, 1), np.bool_))
    found = correct(np.full((1, 1, 1), reading), np.zeros((1, 1, 1)), device)
    # first order: what is left out is (σ/gain)², 0.04 %, of the mean, and 0.2 % of the variance
    mean, variance = float(found.detections[0, 0, 0]), float(found.variance[0, 0, 0])
    yield exact_row("corrected pixel", "detections", float(sample.mean()), mean, 0.002 * mean)
    yield exact_row(
        "corrected pixel", "variance", float(sample.var()), variance, 0.015 * sample.var()
    )


def check_filling() -> Iterator[Row]:
    """A hole of one and of two pixels against the weighed mean of what lies about it."""
    rng = np.random.default_rng(33)
    values, variance = rng.uniform(0, 100, (2, 1, 7, 8))
    bad = np.zeros(values.shape, np.bool_)
    bad[0, 3, 3] = bad[0, 3, 4] = bad[0, 0, 7] = True
    found = filled_in(values, variance, bad)
    for y, x in ((3, 3), (3, 4), (0, 7)):
        total = mean = spread = 0.0
        for row in range(max(y - 1, 0), min(y + 2, 7)):
            for column in range(max(x - 1, 0), min(x + 2, 8)):
                if not bad[0, row, column]:
                    weight = 2.0 if row == y or column == x else 1.0  # an edge counts twice
                    total += weight
                    mean += weight * values[0, row, column]
                    spread += weight**2 * variance[0, row, column]
        expected = mean / total, spread / total**2
        for name, right, got in zip(("value", "variance"), expected, found, strict=True):
            yield exact_row(f"filled pixel {y}, {x}", name, right, float(got[0, y, x]), 1e-9)


def check_ambiguity() -> Iterator[Row]:
    """Where a reading may stand for more light, against the closed form of the falling curve."""
    dead = _PARALYZABLE.dead_time.dead_time_s / _PARALYZABLE.exposure_s
    curve = response_curve(_PARALYZABLE)
    a = np.linspace(1, 2, 2000) / dead  # from the peak at 1/τ to twice as much light
    mean = a * (1 - dead) * np.exp(-a * dead) + 1 - np.exp(-a * dead)
    variance = reading_moments(a[:, None, None] / _PARALYZABLE.exposure_s, _PARALYZABLE)[1].ravel()
    expected = float((mean - 3 * np.sqrt(variance)).min())
    # nodes of the curve are 4 % apart in light
    found = curve.ambiguous_from
    yield exact_row("paralyzable", "first ambiguous reading", expected, found, 0.03 * expected)
    never = response_curve(_NONPARALYZABLE).ambiguous_from
    yield exact_row("nonparalyzable", "never ambiguous", 1, float(np.isinf(never)), 1e-9)
    wrapping = changed(_IDEAL, counter=DigitalCounter(capacity=255, overflow="wrap"))
    wraps = response_curve(wrapping).ambiguous_from
    yield exact_row("wrapping", "ambiguous", 1, float(wraps < 255), 1e-9)


def check_curvature() -> Iterator[Row]:
    """Corrected readings summed over their law: what scatter adds by curvature is taken off.

    Of light a and a dead time of a share d of the exposure the inverse of the curve adds a·d to the
    mean and 2·a·d to the variance; what is left of higher order is below a five-thousandth of the
    one and a tenth of the other.
    """
    dead, light, capacity = 1e-3, 100.0, 255
    kind = DeadTime(kind="nonparalyzable", dead_time_s=dead * _IDEAL.exposure_s)
    curve = response_curve(
        changed(_IDEAL, dead_time=kind, counter=DigitalCounter(capacity=capacity))
    )
    n = np.arange(1, capacity + 1)
    reached = np.concatenate(([1.0], gammainc(n, light - (n - 1) * light * dead), [0.0]))
    found, stated = curve.arrivals_of(np.arange(capacity + 1.0))
    law = -np.diff(reached)
    mean = float(law @ found)
    variance, added = float(law @ (found - mean) ** 2), light * dead
    term = "corrected, over the law"
    yield exact_row(term, "mean of detections", light, mean, 0.01 * added)
    yield exact_row(term, "mean of stated variances", variance, float(law @ stated), 0.5 * added)


def _corrected_rows(
    term: str, sensor: Sensor, calibration: Calibration, share: float
) -> Iterator[Row]:
    """Mean of the frames against the light, and their scatter against what is stated."""
    curve = calibration.curve
    brightest = float(curve.arrivals_of(np.array([share * curve.largest]))[0][0])
    light = np.broadcast_to(brightest * np.linspace(0.4, 1, _SHAPE[1]), _SHAPE)
    factor = draw_fixed_pattern(sensor, _SHAPE).efficiency_factor
    rate = np.broadcast_to(light * factor / sensor.exposure_s, (_FRAMES, *_SHAPE))
    exposure = expose_rate(rate, sensor, seed=6, sequence=term)
    corrected = correct(exposure.counts, exposure.saturated, calibration)
    good = ~corrected.filled.any(axis=0)
    mean, found = (each[:, good] for each in (corrected.detections, corrected.variance))
    ratio = float(mean.mean(axis=0).sum() / light[good].sum())
    yield exact_row(term, "mean over the light", 1, ratio, _MEAN_TOLERANCE)
    known = calibration.dark_variance + light**2 * calibration.gain_variance
    own = found.mean(axis=0) - (known / calibration.gain**2)[good]
    drawn = float(mean.var(axis=0).sum() / own.sum())
    yield exact_row(term, "drawn variance over stated", 1, drawn, _VARIANCE_TOLERANCE)
