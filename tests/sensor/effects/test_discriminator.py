import numpy as np
import pytest

from megalopta.sensor import Sensor, changed, event_moments, expose_rate, preset

MISSED, EXPOSURES, RATE_HZ = 0.3, 20_000, 2e6
DEAD = {"kind": "nonparalyzable", "dead_time_s": 1e-6}


def sensor(missed: float, **effects) -> Sensor:
    return changed(preset("ideal"), exposure_s=2e-5, discriminator={"missed": missed}, **effects)


@pytest.mark.parametrize("effects", [{}, {"dead_time": DEAD}], ids=["none", "dead time"])
def test_counts_are_those_of_avalanches_thinned(effects):
    light = np.full((1, EXPOSURES, 1), RATE_HZ)
    mean, variance = (each[0, 0, 0] for each in event_moments(light[:, :1], sensor(0, **effects)))
    expected = (1 - MISSED) * mean
    spread = (1 - MISSED) ** 2 * variance + MISSED * expected
    counts = expose_rate(light, sensor(MISSED, **effects), seed=1, sequence="t").counts
    # |z| < 5: false alarm 6e-7
    assert abs(counts.mean() - expected) < 5 * (spread / EXPOSURES) ** 0.5
    assert abs(counts.var() - spread) < 5 * spread * (3 / EXPOSURES) ** 0.5
    stated = [each[0, 0, 0] for each in event_moments(light[:, :1], sensor(MISSED, **effects))]
    np.testing.assert_allclose(stated, [expected, spread], rtol=0.03)  # the table's errors
