"""Counting and binary cameras: what was made is found, with the stated confidence."""

import numpy as np
import pytest

from megalopta.sensor import DigitalCounter, changed, expose_rate, preset
from megalopta.sensor.calibrate.counts import calibrate_counts, summed, summed_bits
from megalopta.sensor.calibrate.misfit import pooled_misfit
from megalopta.sensor.calibrate.pixels import correlation
from megalopta.sensor.calibrate.statistics import statistics
from megalopta.sensor.spad.device import draw_fixed_pattern

SHAPE = (24, 24)
LIGHTS_HZ = (1e6, 5e6, 2e7)
BINARY = {"frames": 3000, "dark": (1e-3, 1e-2), "flat": 1e-5, "lights": (1e5, 5e5)}
DIM = {"dark": (2e-3, 1e-2), "lights": (5e4, 5e5, 2e6, 3e6)}


def camera(seed, capacity=None, dead_time_s=50e-9, kind="nonparalyzable", **fields):
    """An array whose dark counts and efficiency scatter; capacity 1: binary."""
    dark_counts = {
        "bulk_mean_hz_um2": 1.0,
        "bulk_sigma_hz_um2": 0.3,
        "hot_fraction": 0.02,
        "hot_mean_hz_um2": 100.0,
        "hot_sigma_hz_um2": 0.5,
    }
    return changed(
        preset("ideal"),
        device_seed=seed,
        pitch_m=10e-6,
        dark_counts=dark_counts,
        counter=DigitalCounter(**{"capacity": capacity} if capacity else {}),
        **{
            "dead_time": {"kind": kind, "dead_time_s": dead_time_s} if dead_time_s else {},
            **fields,
        },
    )


def sensitivity(seed):
    """Events per photon of every pixel."""
    return 0.2 * np.random.default_rng(seed).uniform(0.8, 1.2, SHAPE)


def dark_rates(sensor):
    """Dark counts of every pixel, Hz."""
    return draw_fixed_pattern(sensor, SHAPE).dark_counts_hz


def frames_of(sensor, exposure_s, light_hz, frames):
    """Counts (n, rows, columns) under uniform light."""
    rates_hz = np.broadcast_to(light_hz * sensitivity(sensor.device_seed), (frames, *SHAPE))
    exposed, name = changed(sensor, exposure_s=exposure_s), f"{exposure_s} {light_hz}"
    return expose_rate(rates_hz, exposed, seed=6, stream=f"{sensor.device_seed} {name}").counts


def levels_of(
    sensor, frames=300, lights=LIGHTS_HZ, dark=(0.01, 0.05), flat=1e-4, spoil=lambda counts: counts
):
    """Dark recordings, and flat ones of several lights."""
    return [
        summed(
            spoil(frames_of(sensor, exposure_s, light_hz, frames).copy()),
            exposure_s,
            light_hz,
            is_binary=sensor.counter.capacity == 1,
        )
        for exposure_s, light_hz in [*((s, 0.0) for s in dark), *((flat, hz) for hz in lights)]
    ]


def covered(estimate, truth):
    """Share of the known pixels whose interval holds the truth."""
    known = np.isfinite(estimate.value)
    return float(((estimate.low <= truth) & (truth <= estimate.high))[known].mean())


@pytest.mark.slow
def test_dead_time_next_to_crosstalk():
    sensor = camera(1, dead_time_s=1e-6, crosstalk={"mean_fired_neighbors": 0.04})
    found = calibrate_counts(levels_of(sensor, dark=(2e-3, 1e-2), lights=(5e4, 5e5, 5e6)))
    # busy neighbors fire fewer: without that it would be 4 % too long, 20 standard errors
    assert found.dead_time.recovery.dead_s == pytest.approx(1e-6, abs=5 * found.dead_time.error_s)
    assert found.dead_time.error_s < 0.004 * 1e-6


@pytest.mark.slow
def test_a_dead_time_that_does_not_fit_is_told_without_interval():
    levels = levels_of(camera(1, dead_time_s=1e-6), **DIM)
    # of the middle light
    levels[-2] = levels[-2]._replace(light_hz=1.1 * levels[-2].light_hz)
    found = calibrate_counts(levels)
    assert found.dead_time is None and found.efficiency is None
    assert "differ from its curve" in found.refused["dead time"]
    assert found.fits["dead time"].is_clear and not found.fits["dark counts"].is_clear


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, BINARY])
def test_intervals_cover_as_stated_over_20_devices(options):
    dark, light = [], []
    for seed in range(20):
        sensor = camera(seed, capacity=1 if options else None, dead_time_s=0 if options else 5e-8)
        found = calibrate_counts(levels_of(sensor, **options))
        dark.append(covered(found.dark_counts_hz, dark_rates(sensor)))
        light.append(covered(found.efficiency, sensitivity(seed)))
    # 11 520 pixels: a false alarm at 93 or 97 % is 10 standard errors away, below 1e-20
    assert 0.93 < np.mean(dark) < 0.97
    assert 0.93 < np.mean(light) < 0.97


def test_rates_of_bits_are_those_of_their_closed_form():
    # 1 − exp(−r·T) of 2000 frames at r·T = 0.5; the sum of all pixels has an error of 0.1 %
    bits = np.random.default_rng(4).random((2000, *SHAPE)) < -np.expm1(-0.5)
    found = calibrate_counts([summed(bits.astype(np.uint8), 1e-3, 0.0, is_binary=True)])
    assert found.dark_counts_hz.value.mean() == pytest.approx(500, rel=6e-3)
    assert "uniform light" in found.refused["efficiency"]


def test_sums_of_bits_give_the_estimates_of_the_bits():
    sensor = camera(7, capacity=1, dead_time_s=0.0)
    kinds = [], []
    for exposure_s, light_hz in ((0.001, 0.0), (1e-6, 1e6), (1e-6, 5e6)):
        bits = frames_of(sensor, exposure_s, light_hz, 300)
        bits[:, 1, 2], bits[:, 3, 4] = 0, 1
        sums = bits.reshape(2, 150, *SHAPE).sum(axis=1)
        kinds[0].append(summed(bits, exposure_s, light_hz, is_binary=True))
        kinds[1].append(summed_bits(sums, 150, exposure_s, light_hz))
    one, other = (calibrate_counts(levels) for levels in kinds)
    assert one.dead[1, 2] and one.stuck[3, 4]
    for name in ("dead", "stuck", "hot", "saturated", "reading"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name in ("dark_counts_hz", "efficiency"):
        mine, theirs = (vars(getattr(device, name)) for device in (one, other))
        np.testing.assert_allclose(list(mine.values()), list(theirs.values()), rtol=1e-9)


def spoilt(counts):
    """A dead, a stuck and a full pixel."""
    counts[:, 1, 2], counts[:, 3, 4], counts[:, 5, 6] = 0, 7, 255
    return counts


def test_bad_and_hot_pixels_are_told_apart():
    sensor = camera(5, capacity=255, dead_time_s=0)
    found = calibrate_counts(levels_of(sensor, lights=(1e6, 5e6), spoil=spoilt))
    assert found.dead[1, 2]
    assert found.stuck[3, 4]
    assert found.stuck[5, 6]
    assert found.bad.sum() == 3
    hot = dark_rates(sensor) > 11 * np.median(dark_rates(sensor))
    hot[1, 2] = hot[3, 4] = hot[5, 6] = False
    np.testing.assert_array_equal(found.hot[hot], True)


@pytest.mark.parametrize("is_binary", [False, True])
def test_few_counts_in_the_dark(is_binary):
    """Medians of 0 counts; the likeliest false alarm, 8 counts of mean 0.5, is below 1e-7."""
    frames = np.random.default_rng(0).poisson(0.5 / 400, (400, 64, 64)).clip(0, 1)
    frames[::8, 5, 7] = 1
    dark = summed(frames.astype(np.uint16), 1e-4, 0.0, is_binary=is_binary)
    found = calibrate_counts([dark])
    assert np.argwhere(found.hot).tolist() == [[5, 7]]
    # a rate whose frames are all 0 with a chance of 2.5 %: r·n·T = −ln 0.025
    silent = frames.sum(axis=0) == 0
    np.testing.assert_array_equal(found.dark_counts_hz.low[silent], 0)
    most_hz = -np.log(0.025) / (400 * 1e-4)
    np.testing.assert_allclose(found.dark_counts_hz.high[silent], most_hz, rtol=1e-6)


def test_telegraph_noise_is_found_and_its_levels_estimated():
    trap = {"share": 0.01, "step": 10.0, "fastest_s": 0.04, "slowest_s": 0.04}
    sensor, noisy = camera(11), camera(11, telegraph=trap)
    dark = levels_of(noisy, frames=3000, dark=(0.01,), lights=())
    found = calibrate_counts(dark).telegraph
    assert calibrate_counts(levels_of(sensor, dark=(0.01,), lights=())).telegraph is None
    _, (_, active_hz) = draw_fixed_pattern(noisy, SHAPE).dark_levels()
    ratio = active_hz / dark_rates(sensor)
    np.testing.assert_array_equal(found.pixels, ratio > 1.5)
    # 375 switches of each of some six pixels: 8 % each, five errors of the mean of six
    assert found.time_s == pytest.approx(0.04, rel=0.2)
    steps = ((found.high_hz - found.low_hz) / dark_rates(sensor))[found.pixels]
    assert np.median(steps) == pytest.approx(10, rel=0.2)


def test_lights_that_are_not_as_stated_are_refused():
    levels = levels_of(camera(7, dead_time_s=0))
    wrong = [*levels[:-1], levels[-1]._replace(light_hz=0.5 * levels[-1].light_hz)]
    found = calibrate_counts(wrong)
    assert found.efficiency is None
    assert "not proportional to light" in found.refused["efficiency"]
    assert "Not known: dead time" in found.sentence == str(found)
    with pytest.raises(ValueError, match="no brighter than the dark"):
        calibrate_counts([*levels, levels[0]._replace(light_hz=1e6)])
    counts = frames_of(camera(8), 1e-4, 1e6, 200)
    with pytest.raises(ValueError, match="drifts"):
        summed(counts + np.linspace(0, 3, 200)[:, None, None], 1e-4, 1e6, is_binary=False)


def test_recordings_far_from_a_curve_are_named_with_readable_numbers():
    left = np.array([[0.0] * 50, [180.0] * 50, [-9.0] * 50, [0.4] * 50])
    misfit = pooled_misfit(left, np.ones((4, 50)), np.full((4, 50), 10.0), 2)
    assert misfit.is_clear and misfit.summary() == "a mean 19 times as high"
    told = misfit.summary(["dark.tif", "led_A.tif", "led_C.tif", "led_B.tif"])
    assert told == "led_A.tif 19 times as high; led_C.tif 90 % too low"


@pytest.mark.slow
def test_rare_events_are_seldom_taken_for_telegraph_noise():
    # Beyond 4.5 standard deviations are 3.4e-6 of a normal variable, so 0.85 of both sums of 125,000
    # pixels. 10 or more have a probability below 1e-6. Without regard to the skewness of rare
    # events there are 16.
    bits = np.random.default_rng(0).random((400, 250, 500), np.float32) < 0.12
    found = correlation(statistics(bits), np.ones((250, 500), np.bool_))
    assert (found.deviation > 4.5).sum() < 10
