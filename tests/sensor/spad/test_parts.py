"""Mean and variance where light changes within the exposure, against draws and closed forms."""

import numpy as np
import pytest

from megalopta.sensor import Gate, changed, event_moments, expose_rate, preset

EXPOSURE_S, TAU_S, PIXELS = 1e-4, 1e-6, (100, 100)
IDEAL = changed(preset("ideal"), exposure_s=EXPOSURE_S)


def all_at_once(parts, brightest_hz, of_every=0):
    """All light in one part, or in every other one."""
    light = np.zeros((1, parts, *PIXELS))
    light[:, :: of_every or parts] = brightest_hz
    return light


@pytest.mark.parametrize(
    ("kind", "parts", "of_every", "carriers"),
    [
        ("nonparalyzable", 2, 0, 0.0),
        ("nonparalyzable", 8, 2, 0.0),
        ("paralyzable", 2, 0, 0.0),
        ("paralyzable", 8, 2, 0.0),
        ("nonparalyzable", 8, 2, 0.2),  # a table, which costs seconds
    ],
)
def test_stated_moments_hold_in_the_strongest_change(kind, parts, of_every, carriers):
    traps = {"mean_carriers": carriers, "delay_s": TAU_S / 2}
    dead = {"kind": kind, "dead_time_s": TAU_S}
    sensor = changed(IDEAL, dead_time=dead, afterpulsing=traps)
    rate = all_at_once(parts, 1 / TAU_S, of_every)
    counts = expose_rate(rate, sensor, seed=3, stream="parts").counts.astype(float)
    mean, variance = np.ravel(event_moments(rate[..., :1, :1], sensor))
    # dead for less than 1 − 1/e of the time, and fewer than 0.2 carriers wait; |z| < 5
    off_by = parts * (0.64 + 0.2 * (carriers > 0)) / (1 - carriers)
    tables = 0.01 * mean * (carriers > 0)  # 3 standard errors
    assert abs(counts.mean() - mean) < off_by + tables + 5 * counts.std() / 100
    spread = 0.1 * parts + 0.05 * variance * (carriers > 0)
    assert abs(counts.var() - variance) < spread + 5 * counts.var() * np.sqrt(2) / 100
    # the mean light would be off by much more
    level, _ = event_moments(rate.mean(axis=1)[..., :1, :1], sensor)
    assert abs(level[0, 0, 0] - counts.mean()) > 3 * abs(mean - counts.mean())


def test_without_memory_stated_moments_are_those_of_poisson_counts():
    gate = Gate(period_s=EXPOSURE_S, width_s=EXPOSURE_S / 4, phase_s=EXPOSURE_S / 8)
    sensor = changed(IDEAL, gate=gate.model_dump())
    rate = np.random.default_rng(0).uniform(1e5, 1e6, (2, 4, 6, 8))
    # open from 1/8 to 3/8 of the exposure: in half of the first and of the second quarter
    expected = rate[:, :2].sum(axis=1) * EXPOSURE_S / 8
    for moments in event_moments(rate, sensor):
        np.testing.assert_allclose(moments, expected, rtol=1e-12)
    drawn = expose_rate(np.repeat(rate[:1], 2000, 0), sensor, seed=0, stream="gate").counts
    z = (drawn.mean(axis=0) - expected[0]) / np.sqrt(expected[0] / 2000)
    assert np.abs(z).max() < 6  # 48 pixels: false alarm 1e-7
