"""Devices that are known, and what an ADC would record of them."""

import numpy as np

from megalopta.sensor import AnalogCounter, DeadTime, changed, expose_adc, preset
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


def efficiency_of(sensor, shape=SHAPE):
    """Events per photon of every pixel."""
    mean = sensor.photon_detection_efficiency(np.array(NANOMETERS))
    return mean * draw_fixed_pattern(sensor, shape).efficiency_factor


def levels_of(
    sensor,
    frames=400,
    shape=SHAPE,
    dark_s=DARK_EXPOSURES_S,
    flat_s=FLAT_EXPOSURE_S,
    lights_hz=LIGHTS_HZ,
):
    """Codes of dark frames, and of flats whose light is in photons per second on a pixel."""
    levels = []
    for exposure_s, light_hz in [*((s, 0.0) for s in dark_s), *((flat_s, hz) for hz in lights_hz)]:
        own = changed(sensor, exposure_s=exposure_s)
        rates = np.broadcast_to(light_hz * efficiency_of(sensor, shape), (frames, *shape))
        stream = f"{sensor.device_seed} {exposure_s} {light_hz}"
        levels.append(Level(expose_adc(rates, own, seed=1, stream=stream), exposure_s, light_hz))
    return levels
