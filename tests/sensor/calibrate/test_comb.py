"""A step that changes over the swing, and afterpulses, in what the ADC of a device reads."""

import numpy as np
import pytest

from megalopta.sensor import Afterpulsing, AnalogCounter, changed, expose_adc, preset
from megalopta.sensor.calibrate.comb import Curve
from megalopta.sensor.calibrate.device import calibrate_device
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.calibrate.neighbors import neighbor_kernel
from megalopta.sensor.spad.device import draw_fixed_pattern

from .devices import DARK_EXPOSURES_S, NANOMETERS, adc_of

SHAPE = (8, 8)


def levels_of(sensor, lights_hz=(2e8, 1e9), frames=120):
    """What the ADC reads, by the sensor model itself; light in photons per second on a pixel."""
    found = []
    flat = [(2e-4, light) for light in lights_hz]
    for exposure_s, light_hz in [*((each, 0.0) for each in DARK_EXPOSURES_S[::2]), *flat]:
        own = changed(sensor, exposure_s=exposure_s)
        share = sensor.photon_detection_efficiency(np.array(NANOMETERS))
        rate = light_hz * share * draw_fixed_pattern(own, SHAPE).efficiency_factor
        rates = np.broadcast_to(rate, (frames, *SHAPE))
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
    found = calibrate_device(levels_of(sensor), adc_of(sensor))
    # 5 standard errors: 6e-7
    assert abs(found.curve.slope - slope) < 5 * found.slope_error
    assert found.slope_error < 2e-3
    assert found.is_slope_seen == (slope > 0)
    pattern = draw_fixed_pattern(sensor, SHAPE)
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
    found = calibrate_device(levels_of(sensor), adc_of(sensor))
    assert found.kernel is not None
    assert np.isnan(found.kernel.afterpulses)
