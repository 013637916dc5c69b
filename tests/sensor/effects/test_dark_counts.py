import numpy as np
import pytest
from scipy.stats import truncnorm

from megalopta.sensor.change import changed
from megalopta.sensor.effects.dark_counts import DarkCounts, dark_count_rate, mean_density
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


def densities(dark_counts, devices=1000):
    return np.concatenate(
        [dark_count_rate(dark_counts, (32, 32), UM2, seed).ravel() for seed in range(devices)]
    )


@pytest.mark.parametrize("dark_counts", [SPADCAM, BROAD])
def test_mean_over_devices_matches_closed_form(dark_counts):
    values = densities(dark_counts)
    z = (values.mean() - mean_density(dark_counts)) / (values.std() / np.sqrt(values.size))
    assert abs(z) < 5  # false alarm 6e-7


@pytest.mark.parametrize("dark_counts", [SPADCAM, BROAD])
def test_variance_over_devices_matches_closed_form(dark_counts):
    values = densities(dark_counts)
    squares = (values - values.mean()) ** 2
    mean, sigma = dark_counts.bulk_mean_hz_um2, dark_counts.bulk_sigma_hz_um2
    bulk = truncnorm(-mean / sigma, np.inf, mean, sigma).moment(2)
    hot = dark_counts.hot_mean_hz_um2**2 + dark_counts.hot_sigma_hz_um2**2
    share = dark_counts.hot_fraction
    expected = (1 - share) * bulk + share * hot - mean_density(dark_counts) ** 2
    error = squares.mean() - expected
    assert abs(error) < 5 * squares.std() / np.sqrt(values.size)  # false alarm 6e-7


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


def test_rates_are_never_negative_even_where_the_bulk_is_cut_hard():
    assert densities(BROAD, devices=50).min() >= 0


def test_rate_is_proportional_to_the_active_area():
    small, large = (dark_count_rate(SPADCAM, (4, 4), area * UM2, 3) for area in (36, 360))
    np.testing.assert_allclose(large, 10 * small, rtol=1e-14)


def test_pattern_belongs_to_the_device_and_not_to_the_image_size():
    whole = dark_count_rate(SPADCAM, (120, 160), UM2, 3)
    np.testing.assert_array_equal(dark_count_rate(SPADCAM, (16, 16), UM2, 3), whole[:16, :16])
    assert not np.any(dark_count_rate(SPADCAM, (16, 16), UM2, 4) == whole[:16, :16])


def test_default_has_no_dark_counts():
    assert np.all(dark_count_rate(DarkCounts(), (5, 5), 1.0, 0) == 0)


def test_distribution_without_spread_gives_every_pixel_its_mean():
    equal = DarkCounts(bulk_mean_hz_um2=2.0)
    assert np.all(dark_count_rate(equal, (5, 5), UM2, 0) == 2.0)


def test_hot_pixels_without_a_rate_are_refused():
    with pytest.raises(ValueError, match="hot_mean_hz_um2: 0 with hot_fraction"):
        DarkCounts(hot_fraction=0.1)


@pytest.mark.parametrize(
    "wrong", [{"bulk_mean_hz_um2": -1.0}, {"hot_fraction": 1.5}, {"bulk_sigma_hz_um2": np.inf}]
)
def test_impossible_distribution_is_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        DarkCounts(**wrong)
