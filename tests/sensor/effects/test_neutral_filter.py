import numpy as np
import pytest

from megalopta.sensor import changed, detection_rate, preset, without
from megalopta.sensor.spad import active_effects, draw_fixed_pattern


def test_light_falls_with_the_density_and_dark_counts_stay():
    plain = preset("spadcam")
    sensor = changed(plain, neutral_filter={"optical_density": 2})
    light, bands = np.ones((1, 3, 4, 1)), [[500.0, 510.0]]
    seen, all_of_it = (detection_rate(light, bands, each) for each in (sensor, plain))
    np.testing.assert_allclose(seen, all_of_it / 100, rtol=1e-12)
    dark, before = (draw_fixed_pattern(each, (3, 4)).dark_counts_hz for each in (sensor, plain))
    np.testing.assert_array_equal(dark, before)
    assert "neutral_filter" in active_effects(sensor)
    assert without(sensor, "neutral_filter") == plain


def test_a_filter_does_not_amplify():
    with pytest.raises(ValueError, match="optical_density"):
        changed(preset("spadcam"), neutral_filter={"optical_density": -1})
