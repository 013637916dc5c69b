"""Frames of a frame camera, step by step in the order of `frame.model`.

**Multiplication**: in each of N stages an electron frees another with probability G^(1/N) − 1 for a
mean gain G. Up to a gain of 200, electrons are followed stage by stage until there are some tens;
what these still free is drawn from a Gamma distribution of the same mean and variance (Basden,
Haniff and Mackay, MNRAS 345, 985, 2003). Above, all is.
"""

import math

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor.effects.dark_counts import telegraph_factor
from megalopta.sensor.frame.model import FrameSensor, pixels
from megalopta.sensor.optics import with_lag
from megalopta.sensor.quantities import Exposure
from megalopta.sensor.sampling import streams
from megalopta.sensor.sampling.poisson import fill_poisson, poisson_streams
from megalopta.sensor.sampling.streams import mixed, uniform

_HIGH_GAIN, _MANY = 200.0, 64.0


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
def multiply(electrons, normals, words, gain, chance, well_e, out):  # type: ignore[no-untyped-def]
    """Draw the charge (N,) behind the register from electrons, normal numbers and random words."""
    for k in range(electrons.size):
        if electrons[k]:
            charge_e = _multiplied(float(electrons[k]), normals[k], words[k], gain, chance)
            out[k] = min(charge_e, well_e)


@compiled
def _multiplied(electrons, z, word, gain, chance):  # type: ignore[no-untyped-def]
    if gain > _HIGH_GAIN:
        excess = (gain - 1) * (1 - chance) / (gain * (1 + chance))  # `excess_noise` less 1
        return gain * excess * _gamma(electrons / excess, z, word)
    per_log = 1 / math.log1p(-chance)
    failures = math.floor(math.log(uniform(word)) * per_log)
    while min(electrons, electrons * (gain - 1)) < _MANY:
        place, freed = failures, 0.0
        while place < electrons:
            word = mixed(word)
            place += 1 + math.floor(math.log(uniform(word)) * per_log)
            freed += 1
        failures = place - electrons
        electrons += freed
        gain /= 1 + chance
        if gain < 1 + chance / 2:  # past the last stage
            return electrons
    scale = (1 - chance) * gain / (1 + chance)
    return electrons + scale * _gamma(electrons * (gain - 1) / scale, z, mixed(word))


@compiled
def _gamma(shape, z, word):  # type: ignore[no-untyped-def]
    """Gamma number of a shape of at least 1, by Marsaglia and Tsang, ACM TOMS 26, 363 (2000)."""
    d = shape - 1 / 3
    c = 1 / math.sqrt(9 * d)
    while True:
        v = (1 + c * z) ** 3
        u = uniform(word)
        if v > 0 and (
            u < 1 - 0.0331 * z**4 or math.log(u) < 0.5 * z * z + d * (1 - v + math.log(v))
        ):
            return d * v
        word = mixed(word)
        radius = math.sqrt(-2 * math.log(uniform(word)))
        word = mixed(word)
        z = radius * math.cos(2 * math.pi * uniform(word))
        word = mixed(word)


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
