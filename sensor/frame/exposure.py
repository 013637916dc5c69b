"""Frames of a frame camera, step by step in the order of `frame.model`."""

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor.effects.dark_counts import telegraph_factor
from megalopta.sensor.frame.model import FrameSensor, pixels
from megalopta.sensor.frame.register import multiply
from megalopta.sensor.optics import with_lag
from megalopta.sensor.quantities import Exposure
from megalopta.sensor.sampling import streams
from megalopta.sensor.sampling.poisson import fill_poisson, poisson_streams


def expose_frames(
    electrons_hz: Floats, sensor: FrameSensor, draw: streams.Draw, state: Floats | None = None
) -> tuple[Exposure, Floats | None]:
    """Draw readings (T, H, W) from rates of photoelectrons of equal pixels, Hz.

    `state` and the second value returned: mean electrons (H, W) that image lag leaves behind; None:
    light was as in the first frame, or there is no lag.
    """
    lagged_hz, after = with_lag(electrons_hz, sensor, state)
    shape, (rows, columns) = lagged_hz.shape, lagged_hz.shape[1:]
    device = pixels(sensor, (rows, columns))
    read, register, period_s = sensor.read, sensor.em, draw.frame_period_s or sensor.exposure_s
    stream = streams.sensor_stream(draw.stream, sensor, np.zeros((1, 1)))
    run = int(streams.generator(draw.seed, "frame telegraph", stream).integers(2**63))
    dark_e, read_e = device.dark_e.ravel(), device.read_e.ravel()
    readings, saturated = np.empty(shape, np.float32), np.empty(shape, np.bool_)
    full_well_e = int(sensor.full_well_e)
    converter = sensor.adc.e_per_dn, sensor.adc.black_dn, float(sensor.adc.largest_dn)

    def expose_frame(index: int) -> None:
        number, light_hz = draw.first_frame + index, lagged_hz[index]
        name = stream, streams.light_key(light_hz), number
        rng = streams.generator(draw.seed, "frame exposure", *name)
        flags = saturated[index].reshape(-1)
        states, size = streams.word_streams(rng, 3), rows * columns
        noise = np.empty(2 * size if register.gain > 1 else size)
        words = np.empty((-(-noise.size // streams.LANES), streams.LANES), np.uint64)
        streams.fill_normals(states[0], states[1], words, streams.EDGES, noise)

        # electrons in the pixel
        electrons = np.empty(size, np.uint32)
        mean_e = (light_hz * device.response).ravel() * sensor.exposure_s
        fill_poisson(poisson_streams(rng), mean_e, dark_e, 1.0, electrons, full_well_e)
        np.greater_equal(electrons, full_well_e, out=flags)

        # electrons behind the register
        charge_e = electrons.astype(np.float64)
        if register.gain > 1:
            streams.fill_words(states[2], words)
            gain = register.gain, register.chance, register.well_e
            multiply(electrons, noise[size:], words.ravel(), *gain, charge_e)
            flags |= charge_e >= register.well_e

        # electrons at the amplifier
        offset_e = device.offset_e + rng.normal(0, read.row_e, (rows, 1))
        offset_e += rng.normal(0, read.column_e, columns)
        if device.traps.pixels.size:  # two levels, as far above as below their mean
            active = telegraph_factor(read.telegraph, device.traps, run, number * period_s) - 1
            offset_e += read.telegraph_e * (active - 0.5 * device.traps.step)

        # DN
        pixel = charge_e, offset_e.ravel(), read_e, noise
        _digitize(*pixel, converter, register.gain, readings[index].reshape(-1), flags)

    streams.over_frames(expose_frame, range(len(lagged_hz)), lagged_hz.size < 2**15)
    return Exposure(readings, saturated), after


@compiled
def _digitize(  # type: ignore[no-untyped-def]
    charge_e, offset_e, read_e, noise, converter, gain, readings, saturated
):
    """Round what amplifiers hold (N,) to DN, and return it to electrons."""
    e_per_dn, black_dn, largest_dn = converter
    for k in range(charge_e.size):
        volts_e = charge_e[k] + offset_e[k] + read_e[k] * noise[k]
        dn = min(max(np.rint(volts_e / e_per_dn + black_dn), 0.0), largest_dn)
        readings[k] = (dn - black_dn) * e_per_dn / gain
        saturated[k] |= dn >= largest_dn
