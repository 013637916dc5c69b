"""Readings interpolated over the light against those from the distribution of each pixel.

The corner of a device is a smaller device of the same pixels, too few of them for a table.
"""

import numpy as np
import pytest

from megalopta.sensor import changed, preset, reading_moments

IDEAL = changed(preset("ideal"), exposure_s=1e-3)
BYTE = {"capacity": 255}
UNEVEN = {
    **{"kind": "analog", "step_v": 0.03, "step_sigma_v": 6e-4, "leak_v_s": 0.5},
    **{"leak_sigma_v_s": 0.05, "read_noise_v": 1e-3, "adc_bits": 12},
}
OFFSETS = {**UNEVEN, "adc_bits": None, "offset_sigma_v": 0.01}
MISREAD = {"kind": "analog", "step_v": 0.1, "swing_v": 1.6, "read_noise_v": 0.05}
ACTIVE = {"kind": "nonparalyzable", "dead_time_s": 1e-6}
PASSIVE = {"kind": "paralyzable", "dead_time_s": 1e-6}
RUNNING = {"kind": "paralyzable", "dead_time_s": 2e-5, "start": "stationary"}
LONG = {**PASSIVE, "dead_time_s": 3e-6}
TRAPS = {"afterpulsing": {"mean_carriers": 0.2, "delay_s": 1e-5}}
GATE = {"gate": {"period_s": 1e-4, "width_s": 5e-5}}
CASES = {
    "one bit": ({"counter": {"capacity": 1}}, 2.0),
    "eight bits": ({"counter": BYTE}, 250.0),
    "wrapping": ({"counter": {**BYTE, "overflow": "wrap"}}, 250.0),
    "active": ({"counter": BYTE, "dead_time": ACTIVE}, 300.0),
    "passive": ({"counter": {"capacity": 63}, "dead_time": LONG}, 100.0),
    "passive, running": ({"counter": {"capacity": 15}, "dead_time": RUNNING}, 40.0),
    "afterpulsing, gate": ({"counter": {"capacity": 15}, **TRAPS, **GATE}, 20.0),
    "misread": ({"counter": MISREAD}, 12.0),
    "uneven": ({"counter": UNEVEN}, 105.0),
    "uneven, offsets": ({"counter": OFFSETS}, 105.0),
    "uneven, active": ({"counter": UNEVEN, "dead_time": ACTIVE}, 115.0),
    "uneven, passive": ({"counter": UNEVEN, "dead_time": PASSIVE}, 115.0),
}
SLOW = "afterpulsing, gate"


@pytest.mark.parametrize(
    "name", [*(name for name in CASES if name != SLOW), pytest.param(SLOW, marks=pytest.mark.slow)]
)
def test_interpolated_readings_are_those_of_each_pixels_distribution(name):
    changes, arrivals = CASES[name]
    sensor = changed(IDEAL, **changes)
    share = np.random.default_rng(0).uniform(0.5, 1.5, (1, 96, 96))
    rate = share * arrivals / sensor.exposure_s
    mean, variance = np.array(reading_moments(rate, sensor))[:, :, :6, :6]
    exact_mean, exact_variance = reading_moments(rate[:, :6, :6], sensor)
    # moments of afterpulsing are polynomials between nodes, with corners there, right to 3e-3
    off = 100 if "afterpulsing" in changes else 1
    # full counters hardly vary: their deviation counts as a hundredth of a count
    sigma = np.sqrt(np.maximum(exact_variance, 1e-4))
    assert np.abs((mean - exact_mean) / sigma).max() < 2e-6 * off
    assert np.abs((variance - exact_variance) / np.maximum(exact_variance, 1e-2)).max() < 2e-5 * off
    is_table = not np.array_equal(mean, exact_mean)
    assert is_table, "the frame is large enough for a table"


def test_a_frame_in_light_of_all_levels_needs_no_table_of_all_of_them():
    sensor = changed(IDEAL, counter={**BYTE, "overflow": "wrap"})
    rate = np.geomspace(1e-2, 1e9, 4096).reshape(1, 64, 64) / sensor.exposure_s
    mean, _ = reading_moments(rate, sensor)
    few, _ = reading_moments(rate[:, ::16, ::16], sensor)
    np.testing.assert_allclose(mean[:, ::16, ::16], few, rtol=1e-6)
