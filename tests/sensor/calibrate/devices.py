"""Devices that are known, and what an ADC would record of them."""

import numpy as np

from megalopta.sensor import AnalogCounter, DeadTime, DigitalCounter, changed, expose_rate, preset
from megalopta.sensor.calibrate.level import Adc, Level
from megalopta.sensor.spad.device import draw_fixed_pattern

SHAPE = (16, 16)
DARK_EXPOSURES_S = (1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
FLAT_EXPOSURE_S = 2e-4
LIGHTS_HZ = (2e7, 5e7, 1e8, 2e8, 4e8, 7e8)
NANOMETERS = 700.0


def device(seed, kind="paralyzable", dead_time_s=1e-6, **counter):
    """A SPADCAM whose steps and offsets scatter too."""
    scatter = {"step_sigma_v": 3e-4, "offset_sigma_v": 1e-3, **counter}
    spadcam = preset("spadcam")
    return changed(
        spadcam,
        device_seed=seed,
        counter=AnalogCounter(**{**spadcam.counter.model_dump(), **scatter}),
        dead_time=DeadTime(kind=kind, dead_time_s=dead_time_s),
    )


def adc_of(sensor):
    """Its converter."""
    counter = sensor.counter
    top = counter.supply_v / counter.lsb_v
    return Adc(counter.lsb_v, top, (counter.supply_v - counter.swing_v) / counter.lsb_v)


def recorded(sensor, exposure_s, light_hz, frames, seed=1, shape=SHAPE):
    """Codes of frames under even light of so many photons per second on a pixel."""
    counter = sensor.counter
    sensor = changed(sensor, exposure_s=exposure_s)
    pattern = draw_fixed_pattern(sensor, shape)
    efficiency = np.interp(NANOMETERS, sensor.efficiency.wavelengths_nm, sensor.efficiency.values)
    rate = np.broadcast_to(light_hz * efficiency * pattern.efficiency_factor, (frames, *shape))
    name = f"{sensor.device_seed} {exposure_s} {light_hz}"
    events = changed(sensor, counter=DigitalCounter())
    counts = expose_rate(rate, events, seed=seed, stream=name).counts
    pixels = pattern.counters
    fall = np.minimum(counts * pixels.step_v + pixels.leaked_v, counter.swing_v)
    rng = np.random.default_rng([seed, sensor.device_seed, round(1e6 * exposure_s), int(light_hz)])
    volts = counter.supply_v + pixels.offset_v - fall
    volts = volts + counter.read_noise_v * rng.standard_normal(volts.shape)
    codes = np.rint(volts / counter.lsb_v).clip(0, 2**counter.adc_bits - 1)
    return Level(codes.astype(np.uint16), exposure_s, light_hz)


def levels_of(sensor, frames=400, seed=1, shape=SHAPE):
    """Dark frames of nine exposures, flats of six lights."""
    dark = [(exposure, 0.0) for exposure in DARK_EXPOSURES_S]
    flat = [(FLAT_EXPOSURE_S, light) for light in LIGHTS_HZ]
    return [recorded(sensor, *each, frames, seed, shape) for each in (*dark, *flat)]
