import numpy as np
import pytest
from scipy.stats import truncnorm

from megalopta.sensor.change import changed
from megalopta.sensor.effects.dark_counts import DarkCounts, dark_count_density
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.presets import preset

SPADCAM = preset("spadcam").dark_counts
UM2 = 1e-12
BROAD = DarkCounts(
    bulk_mean_hz_um2=1.0,
    bulk_sigma_hz_um2=2.0,
    hot_fraction=0.2,
    hot_mean_hz_um2=9.0,
    hot_sigma_hz_um2=3.0,
)


@pytest.mark.slow
def test_spadcam_pixels_have_the_measured_statistics():
    # dissertation §2.4.7; sampling error over a million pixels is below 0.005, the fit's below 0.01
    sensor = preset("spadcam")
    devices = [changed(sensor, device_seed=seed) for seed in range(1000)]
    rates = np.concatenate(
        [draw_fixed_pattern(each, (32, 32)).dark_counts_hz.ravel() for each in devices]
    )
    values = rates / (sensor.active_area_m2 / UM2)
    assert values.mean() == pytest.approx(1.77, abs=0.015)
    assert np.median(values) == pytest.approx(0.93, abs=0.015)
    assert values.std() == pytest.approx(1.77, abs=0.015)
    assert 16 * np.mean(values < 1.5) == pytest.approx(11, abs=0.1)


@pytest.mark.parametrize("dark_counts", [SPADCAM, BROAD])
def test_densities_over_devices_have_the_moments_of_the_mixture(dark_counts):
    values = np.concatenate(
        [dark_count_density(dark_counts, (32, 32), seed).ravel() for seed in range(1000)]
    )
    assert values.min() >= 0
    mean, sigma = dark_counts.bulk_mean_hz_um2, dark_counts.bulk_sigma_hz_um2
    bulk = truncnorm(-mean / sigma, np.inf, mean, sigma)
    hot = dark_counts.hot_mean_hz_um2, dark_counts.hot_sigma_hz_um2
    share = dark_counts.hot_fraction
    first = (1 - share) * bulk.mean() + share * hot[0]
    second = (1 - share) * bulk.moment(2) + share * (hot[0] ** 2 + hot[1] ** 2)
    # false alarm 6e-7 each
    assert abs(values.mean() - first) < 5 * values.std() / np.sqrt(values.size)
    squares = values**2
    assert abs(squares.mean() - second) < 5 * squares.std() / np.sqrt(values.size)


def test_pattern_belongs_to_the_device_and_not_to_the_image_size():
    whole = dark_count_density(SPADCAM, (120, 160), 3)
    np.testing.assert_array_equal(dark_count_density(SPADCAM, (16, 16), 3), whole[:16, :16])
    assert not np.any(dark_count_density(SPADCAM, (16, 16), 4) == whole[:16, :16])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"bulk_mean_hz_um2": -1.0}, "bulk_mean_hz_um2"),
        ({"hot_fraction": 1.5}, "hot_fraction"),
        ({"bulk_sigma_hz_um2": np.inf}, "bulk_sigma_hz_um2"),
        ({"hot_fraction": 0.1}, "hot_mean_hz_um2: 0 with hot_fraction"),
    ],
)
def test_impossible_distribution_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        DarkCounts(**fields)
