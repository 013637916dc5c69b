"""Devices whose pixels are known, calibrated from what their ADC reads."""

from dataclasses import replace

import numpy as np
import pytest

from megalopta.sensor import Afterpulsing, AnalogCounter, changed, expose_adc, preset
from megalopta.sensor.calibrate.comb import Curve
from megalopta.sensor.calibrate.crosstalk import neighbor_kernel
from megalopta.sensor.calibrate.device import calibrate_device
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.spad.device import draw_fixed_pattern

from .devices import DARK_EXPOSURES_S, NANOMETERS, SHAPE, adc_of, device, levels_of

NAMES = ("dark_counts_hz", "efficiency", "step_v", "leak_v_s", "dead_time_s")


def covered(sensor):
    """Share of pixels whose stated 95 % interval holds the truth, by quantity."""
    found = calibrate_device(levels_of(sensor), adc_of(sensor))
    pattern = draw_fixed_pattern(sensor, SHAPE)
    curve = sensor.efficiency
    truth = {
        "dark_counts_hz": pattern.dark_counts_hz,
        "efficiency": pattern.efficiency_factor
        * np.interp(NANOMETERS, curve.wavelengths_nm, curve.values),
        "step_v": pattern.counters.step_v,
        "leak_v_s": pattern.counters.leaked_v / sensor.exposure_s,
        "dead_time_s": np.full(SHAPE, sensor.dead_time.dead_time_s),
    }
    shares = {}
    for name, value in truth.items():
        estimate = getattr(found, name)
        shares[name] = float(((estimate.low <= value) & (value <= estimate.high)).mean())
    return shares, found


@pytest.mark.slow
def test_intervals_hold_the_truth_over_20_devices():
    shares, devices = zip(*(covered(device(seed)) for seed in range(20)), strict=True)
    assert {each.dead_time_kind for each in devices} == {"paralyzable"}
    mean = {name: np.mean([each[name] for each in shares]) for name in NAMES}
    # 5120 pixels: the standard error of a share of 95 % is 0.3 %
    assert all(0.93 <= share <= 0.97 for share in mean.values()), mean


@pytest.mark.slow
def test_the_other_kind_of_dead_time_is_named():
    sensor = device(seed=5, kind="nonparalyzable")
    shape = (4, 4)
    found = calibrate_device(levels_of(sensor, 150, shape=shape), adc_of(sensor))
    assert found.dead_time_kind == "nonparalyzable"
    assert np.median(found.dead_time_s.value) == pytest.approx(1e-6, rel=0.05)


@pytest.mark.slow  # covered without so much noise above, with more below
def test_steps_of_a_noisy_comb():
    """Read noise of 0.22 steps, where one reading in forty is nearer to another tooth."""
    sensor = device(seed=6, read_noise_v=2.2e-3)
    found = calibrate_device(levels_of(sensor, 150, shape=(8, 8)), adc_of(sensor))
    truth = draw_fixed_pattern(sensor, (8, 8)).counters.step_v
    z = (found.step_v.value - truth) / ((found.step_v.high - found.step_v.low) / 3.92)
    # χ² of 64 pixels: a root mean square above 1.5 has a chance below 1e-6
    assert np.sqrt(np.nanmean(z**2)) < 1.5


@pytest.mark.slow
def test_hot_pixels_are_marked():
    sensor = device(seed=21)
    found = calibrate_device(levels_of(sensor, 60), adc_of(sensor), hot_times=5)
    truth = draw_fixed_pattern(sensor, SHAPE).dark_counts_hz
    clear = np.abs(truth / (5 * np.median(truth)) - 1) > 0.1
    assert (found.hot == (truth > 5 * np.median(truth)))[clear].all()


SPADCAM = device(seed=2)
ADC = adc_of(SPADCAM)


@pytest.fixture(scope="module")
def recordings():
    return levels_of(SPADCAM, frames=60, shape=(6, 6))


def dark(levels):
    return [level for level in levels if level.is_dark]


def drifting(level):
    """The output falls by 12 codes while the level is recorded."""
    way = np.linspace(0, 12, len(level.readings))[:, None, None]
    return replace(level, readings=(level.readings - way).astype(int))


def noisy(level):
    """Readings that scatter by a step more."""
    noise = np.random.default_rng(1).normal(0, 12, level.readings.shape)
    return replace(level, readings=np.rint(level.readings + noise).clip(0, 4095).astype(int))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda levels: [noisy(level) for level in levels], "hides single events"),
        (lambda levels: [level.at(slice(0, 20)) for level in levels], "20 frames"),
        (lambda levels: levels[len(dark(levels)) :], "dark frames of 0 exposures"),
        (
            lambda levels: [level.mapped(lambda codes: 0 * codes + 80) for level in levels],
            "saturated",
        ),
        (lambda levels: [*dark(levels), replace(levels[0], light_hz=1e7)], "no brighter"),
        (lambda levels: [drifting(levels[0]), *levels[1:]], "drifts"),
        (
            lambda levels: [*dark(levels), levels[0].mapped(lambda codes: codes[:, :3])],
            "pixels",
        ),
    ],
    ids=["noise", "few frames", "no dark", "saturated", "no light", "drifting", "shapes"],
)
def test_refusals(recordings, change, words):
    with pytest.raises(ValueError, match=words):
        calibrate_device(change(recordings), ADC)


SMALL = (8, 8)


def exposed(sensor, lights_hz=(2e8, 1e9), frames=120):
    """What the ADC reads, by the sensor model itself; light in photons per second on a pixel."""
    found = []
    flat = [(2e-4, light) for light in lights_hz]
    for exposure_s, light_hz in [*((each, 0.0) for each in DARK_EXPOSURES_S[::2]), *flat]:
        own = changed(sensor, exposure_s=exposure_s)
        share = sensor.photon_detection_efficiency(np.array(NANOMETERS))
        rate = light_hz * share * draw_fixed_pattern(own, SMALL).efficiency_factor
        rates = np.broadcast_to(rate, (frames, *SMALL))
        name = f"{exposure_s} {light_hz}"
        codes = expose_adc(rates, own, seed=1, stream=name)
        found.append(Level(codes, exposure_s, light_hz))
    return found


def counting(**fields):
    """A SPADCAM whose steps and offsets scatter, and what else is given of its counters."""
    spadcam = preset("spadcam")
    scatter = {"step_sigma_v": 3e-4, "offset_sigma_v": 1e-3}
    counter = AnalogCounter(**{**spadcam.counter.model_dump(), **scatter, **fields})
    return changed(spadcam, device_seed=4, counter=counter)


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


@pytest.mark.slow
@pytest.mark.parametrize("slope", [0.0, 0.05])
def test_the_slope_of_the_step(slope):
    sensor = counting(step_slope=slope)
    found = calibrate_device(exposed(sensor), adc_of(sensor))
    # 5 standard errors: 6e-7
    assert abs(found.curve.slope - slope) < 5 * found.slope_error
    assert found.slope_error < 2e-3
    assert found.is_slope_seen == (slope > 0)
    pattern = draw_fixed_pattern(sensor, SMALL)
    low, high = found.step_v.low, found.step_v.high
    covered = (low <= pattern.counters.step_v) & (pattern.counters.step_v <= high)
    # of 64 pixels at 95 %, fewer than 48 are covered with a chance below 1e-8
    assert covered.sum() > 48


@pytest.mark.parametrize("carriers", [0.0, 0.1])
def test_afterpulses_of_dark_counts(carriers):
    rng = np.random.default_rng(5)
    primaries = rng.poisson(8.0, (1500, 16, 16))
    counts, generation = primaries.copy(), primaries
    while generation.any():
        generation = rng.poisson(carriers * generation)
        counts += generation
    kernel = neighbor_kernel(counts, np.ones((16, 16), bool))
    assert abs(kernel.afterpulses - carriers) < 5 * kernel.afterpulses_error * (1 + 5 * carriers)
    assert kernel.are_afterpulses_seen == (carriers > 0)
    assert not kernel.is_seen


@pytest.mark.slow
def test_noise_hides_afterpulses():
    sensor = counting(read_noise_v=2.2e-3)
    sensor = changed(sensor, afterpulsing=Afterpulsing(mean_carriers=0.05, delay_s=2e-5))
    found = calibrate_device(exposed(sensor), adc_of(sensor))
    assert found.kernel is not None
    assert np.isnan(found.kernel.afterpulses)
