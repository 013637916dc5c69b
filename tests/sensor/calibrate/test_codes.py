"""Devices whose pixels are known, calibrated from what their ADC reads."""

from dataclasses import replace

import numpy as np
import pytest

from megalopta.sensor import DeadTime, changed, expose_adc, preset
from megalopta.sensor.calibrate.comb import Curve
from megalopta.sensor.calibrate.device import calibrate_device
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.spad.device import draw_fixed_pattern

DARK_S = (1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
LIGHTS_HZ = (2e7, 5e7, 1e8, 2e8, 4e8, 7e8)
NANOMETERS = 700.0


def device(seed=4, kind="paralyzable", dead_time_s=1e-6, afterpulsing=None, **counter):
    """A SPADCAM whose steps and offsets scatter too."""
    return changed(
        preset("spadcam"),
        device_seed=seed,
        counter={"step_sigma_v": 3e-4, "offset_sigma_v": 1e-3, **counter},
        dead_time=DeadTime(kind=kind, dead_time_s=dead_time_s),
        afterpulsing=afterpulsing or {},
    )


def efficiency_of(sensor):
    """Events per photon on the active area."""
    curve = sensor.efficiency
    return float(np.interp(NANOMETERS, curve.wavelengths_nm, curve.values))


def levels_of(sensor, frames=120, shape=(8, 8)):
    """Dark frames of nine exposures, flats of six lights, photons per second on a pixel."""
    levels = []
    efficiency = efficiency_of(sensor)
    flats = [(2e-4, light_hz) for light_hz in LIGHTS_HZ]
    for exposure_s, light_hz in [*((exposure_s, 0.0) for exposure_s in DARK_S), *flats]:
        exposed = changed(sensor, exposure_s=exposure_s)
        rate_hz = light_hz * efficiency * draw_fixed_pattern(exposed, shape).efficiency_factor
        rates_hz = np.broadcast_to(rate_hz, (frames, *shape))
        codes = expose_adc(rates_hz, exposed, seed=1, stream=f"{exposure_s} {light_hz}")
        levels.append(Level(codes, exposure_s, light_hz))
    return levels


def true_values(sensor, shape):
    """What its calibration should find, by quantity."""
    pattern = draw_fixed_pattern(sensor, shape)
    return {
        "dark_counts_hz": pattern.dark_counts_hz,
        "efficiency": pattern.efficiency_factor * efficiency_of(sensor),
        "step_v": pattern.counters.step_v,
        "leak_v_s": pattern.counters.leaked_v / sensor.exposure_s,
    }


def covered(estimate, truth):
    """Share of pixels whose interval holds the truth."""
    return float(((estimate.low <= truth) & (truth <= estimate.high)).mean())


@pytest.mark.slow
def test_intervals_hold_the_truth_over_20_devices():
    shape, shares, dead = (16, 16), [], 0
    for seed in range(20):
        sensor = device(seed)
        found = calibrate_device(levels_of(sensor, 400, shape), sensor.counter)
        truth = true_values(sensor, shape)
        assert found.dead_time.recovery.kind == "paralyzable" and found.dead_time.is_kind_clear
        dead += abs(found.dead_time.recovery.dead_s - 1e-6) < 1.96 * found.dead_time.error_s
        shares.append([covered(getattr(found, name), values) for name, values in truth.items()])
        over = truth["dark_counts_hz"] / np.median(truth["dark_counts_hz"]) / 10
        assert (found.hot == (over > 1))[np.abs(over - 1) > 0.1].all()
    # 5120 pixels: the standard error of a share of 95 % is 0.3 %
    mean = np.mean(shares, axis=0)
    assert np.all((mean >= 0.93) & (mean <= 0.97)), dict(zip(truth, mean, strict=True))
    # of 20 intervals of 95 %, 9 fail with a chance of 2e-7
    assert dead > 11


@pytest.mark.slow
def test_steps_and_afterpulses_of_a_noisy_comb():
    """Read noise of 0.22 steps, where one reading in forty is nearer to another tooth."""
    traps = {"mean_carriers": 0.05, "delay_s": 2e-5}
    sensor = device(seed=6, read_noise_v=2.2e-3, afterpulsing=traps)
    found = calibrate_device(levels_of(sensor, 150), sensor.counter)
    truth = true_values(sensor, (8, 8))["step_v"]
    z = (found.step_v.value - truth) / ((found.step_v.high - found.step_v.low) / 3.92)
    # χ² of 64 pixels: a root mean square above 1.5 has a chance below 1e-6
    assert np.sqrt(np.nanmean(z**2)) < 1.5
    # 5 standard errors: a false alarm in 1.7e6
    assert abs(found.kernel.afterpulses - 0.05) < 5 * found.kernel.afterpulses_error


@pytest.mark.slow
@pytest.mark.parametrize("slope", [0.0, 0.05])
def test_the_slope_of_the_step(slope):
    sensor = device(step_slope=slope)
    found = calibrate_device(levels_of(sensor), sensor.counter)
    # 5 standard errors: 6e-7
    assert abs(found.curve.slope - slope) < 5 * found.slope_error
    assert found.slope_error < 2e-3
    assert found.is_slope_seen == (slope > 0)
    # of 64 pixels at 95 %, fewer than 48 are covered with a chance below 1e-8
    assert covered(found.step_v, true_values(sensor, (8, 8))["step_v"]) > 48 / 64


def test_the_curve_is_the_sum_of_its_steps():
    numbers = np.arange(251.0)
    fallen_v = np.zeros(251)
    for before in range(250):
        step_v = 0.01 * (1 + 0.1 * (0.5 - fallen_v[before] / 3.2))
        fallen_v[before + 1] = fallen_v[before] + step_v
    curve = Curve(3.2, 0.1)
    steps = curve.steps(numbers, np.array(0.01))
    np.testing.assert_allclose(steps, fallen_v / 0.01, rtol=1e-9)
    np.testing.assert_allclose(curve.numbers(steps, np.array(0.01)), numbers, atol=1e-9)


@pytest.fixture(scope="module")
def recordings():
    return levels_of(device(seed=2), frames=60, shape=(6, 6))


def dark(levels):
    return [level for level in levels if level.is_dark]


def drifting(level):
    """The output falls by 12 codes while the level is recorded."""
    way = np.linspace(0, 12, len(level.readings))[:, None, None]
    return replace(level, readings=(level.readings - way).astype(int))


def noisy(level):
    """Readings that scatter by a step more."""
    noise = np.random.default_rng(1).normal(0, 12, level.readings.shape)
    return level.mapped(lambda codes: np.rint(codes + noise).clip(0, 4095).astype(int))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda levels: list(map(noisy, levels)), "hides single events"),
        (lambda levels: [level.at(slice(0, 20)) for level in levels], "20 frames"),
        (lambda levels: levels[len(dark(levels)) :], "dark frames of 0 exposures"),
        (lambda levels: [level.mapped(lambda c: 0 * c + 80) for level in levels], "saturated"),
        (lambda levels: [*dark(levels), replace(levels[0], light_hz=1e7)], "no brighter"),
        (lambda levels: [drifting(levels[0]), *levels[1:]], "drifts"),
        (lambda levels: [*dark(levels), levels[0].mapped(lambda c: c[:, :3])], "pixels"),
    ],
    ids=["noise", "few frames", "no dark", "saturated", "no light", "drifting", "shapes"],
)
def test_refusals(recordings, change, words):
    with pytest.raises(ValueError, match=words):
        calibrate_device(change(recordings), device().counter)
