import numpy as np
import pytest
from scipy.stats import truncnorm

from megalopta import sensor as sensors
from megalopta.sensor.effects.dark_counts import dark_count_density, draw_traps, telegraph_factor
from megalopta.sensor.spad.device import draw_fixed_pattern

SPADCAM = sensors.preset("spadcam").dark_counts
UM2 = 1e-12
BROAD = sensors.DarkCounts(
    bulk_mean_hz_um2=1.0,
    bulk_sigma_hz_um2=2.0,
    hot_fraction=0.2,
    hot_mean_hz_um2=9.0,
    hot_sigma_hz_um2=3.0,
)


@pytest.mark.slow
def test_spadcam_pixels_have_the_measured_statistics():
    # dissertation §2.4.7; sampling error over a million pixels is below 0.005, the fit's below 0.01
    sensor = sensors.preset("spadcam")
    devices = [sensors.changed(sensor, device_seed=seed) for seed in range(1000)]
    patterns = [draw_fixed_pattern(device, (32, 32)).dark_counts_hz for device in devices]
    values = np.ravel(patterns) / (sensor.active_area_m2 / UM2)
    assert values.mean() == pytest.approx(1.77, abs=0.015)
    assert np.median(values) == pytest.approx(0.93, abs=0.015)
    assert values.std() == pytest.approx(1.77, abs=0.015)
    assert 16 * np.mean(values < 1.5) == pytest.approx(11, abs=0.1)


@pytest.mark.parametrize("dark_counts", [SPADCAM, BROAD])
def test_densities_over_devices_have_the_moments_of_the_mixture(dark_counts):
    values = np.concatenate(
        [dark_count_density(dark_counts, (32, 32), seed).ravel() for seed in range(200)]
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


DARK = sensors.changed(
    sensors.preset("ideal"), dark_counts=sensors.DarkCounts(bulk_mean_hz_um2=1.0)
)
SLOW = sensors.Telegraph(
    share=0.5, step=1.0, traps=2, active_share=0.3, fastest_s=1.0, slowest_s=1.0
)


def states(telegraph, frames, period_s, shape=(40, 50)):
    """Active traps (frames, H, W)."""
    traps = draw_traps(telegraph, shape, 0, None)
    times_s = period_s * np.arange(frames)
    factors = np.array([telegraph_factor(telegraph, traps, 12345, time_s) for time_s in times_s])
    return (factors - 1) / telegraph.step


def periodogram(states):
    """Power per frequency bin of the variations of each pixel, mean over the pixels."""
    varying = states - states.mean(0)
    squares = np.abs(np.fft.rfft(varying, axis=0)) ** 2 / len(states)
    return squares.reshape(len(squares), -1).mean(1)[1:]


def sampled_lorentzian(count, period_s, time_s, share):
    """Spectrum of one trap whose state is sampled: that of an autoregressive process."""
    kept = np.exp(-period_s / time_s)
    angle = 2 * np.pi * np.arange(1, count // 2 + 1) / count
    return share * (1 - share) * (1 - kept**2) / (1 - 2 * kept * np.cos(angle) + kept**2)


def test_spectrum_of_a_trap_is_lorentzian():
    one = SLOW.model_copy(update={"share": 1.0, "traps": 1})
    # 2000 pixels: a bin scatters by 2.2 %, a mean over 16 by 0.6 %; the mean that is subtracted
    # takes about a part in 1024/20 of the lowest frequencies
    power = periodogram(states(one, 1024, 0.05))[:512].reshape(-1, 16).mean(1)
    expected = sampled_lorentzian(1024, 0.05, 1.0, 0.3).reshape(-1, 16).mean(1)
    np.testing.assert_allclose(power, expected, rtol=0.05)


def test_many_traps_have_a_spectrum_of_one_over_f():
    many = sensors.Telegraph(share=1.0, traps=8, fastest_s=0.1, slowest_s=1000.0)
    power = periodogram(states(many, 2048, 0.5, (20, 25)))
    times_s = np.geomspace(0.1, 1000.0, 4001)
    expected = 8 * np.mean([sampled_lorentzian(2048, 0.5, time_s, 0.5) for time_s in times_s], 0)
    middle = slice(20, 500)
    # 500 pixels and 480 bins: 0.2 %; which times the 4000 traps have scatters by a few percent
    assert power[middle].mean() == pytest.approx(expected[middle].mean(), rel=0.1)
    frequency = np.arange(1, 1025)
    slope = np.polyfit(np.log(frequency[middle]), np.log(power[middle]), 1)[0]
    assert slope == pytest.approx(-1, abs=0.1)


def test_traps_are_active_for_their_share_of_the_time_in_their_share_of_pixels():
    active = states(SLOW, 400, 20.0)
    switching = active.any(0)
    # 2000 pixels, 800 000 independent states; 5 standard errors: false alarm 6e-7 each
    assert abs(switching.mean() - 0.5) < 5 * np.sqrt(0.25 / 2000)
    assert abs(active[:, switching].mean() - 0.6) < 5 * np.sqrt(2 * 0.21 / 400 / switching.sum())


@pytest.mark.parametrize("draw", [sensors.expose_binary, sensors.expose_events])
def test_frames_are_the_same_drawn_alone_or_among_others(draw):
    sensor = sensors.changed(DARK, telegraph=SLOW.model_dump(), exposure_s=1e-3)
    rate = np.full((9, 12, 15), 50.0)
    named = {"seed": 3, "stream": "s", "frame_period_s": 0.5}
    frames = draw(rate, sensor, **named)
    alone = draw(rate[5:6], sensor, first_frame=5, **named)
    if draw is sensors.expose_events:
        assert alone.time_s.size
        np.testing.assert_array_equal(frames.time_s[frames.frame == 5], alone.time_s)
    else:
        np.testing.assert_array_equal(frames[5], alone[0])


@pytest.mark.parametrize("capacity", [2**32 - 1, 400])
def test_counts_have_the_mean_and_variance_that_are_stated(capacity):
    sensor = sensors.changed(
        DARK, telegraph=SLOW.model_dump(), counter={"kind": "digital", "capacity": capacity}
    )
    rate = np.full((600, 6, 6), 10.0)
    counts = sensors.expose_rate(rate, sensor, seed=1, stream="s", frame_period_s=50.0).counts
    mean, variance = np.array(sensors.reading_moments(rate[:1], sensor))[:, 0]
    error = np.sqrt(variance / len(counts))
    assert (np.abs(counts.mean(0) - mean) < 6 * error).all()  # 36 pixels: false alarm 7e-8
    # three or fewer levels of Poisson counts have a kurtosis below 5
    np.testing.assert_allclose(counts.var(0).mean(), variance.mean(), rtol=5 * 2 / np.sqrt(21_600))
    assert (
        sensors.event_moments(rate[:1], sensor)[1].max()
        > 2 * sensors.event_moments(rate[:1], DARK)[1].max()
    )
