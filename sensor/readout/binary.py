"""Binary frames: whether a pixel saw anything during a short exposure, one bit each.

The bit is 1 with probability 1 − exp(−r·T) from a live start, whatever the dead time and the
afterpulses, which come after the first event; mean p, variance p·(1−p). Gated, T is the time open,
and where light changes within the exposure, r its mean over that time. Frames of an array that runs
freely, where a dead time may reach into the next one, are simulated avalanche by avalanche.
Bits are drawn by comparing 16 random bits with p·2¹⁶, where p is taken in single precision, and, in
the two cases in 65536 in which that leaves them open, a further uniform number with the rest of the
exact p: exact to the last bit of p at a quarter of a random word a pixel.

Packed as visionsim does: `np.packbits` along the width, most significant bit first, the last byte
of a row filled up with zeros.
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.avalanches.running import FreeRunning, running_array
from megalopta.sensor.effects.gating import open_fraction, part_weights
from megalopta.sensor.readout.chance import CHANCE_ERROR, chance
from megalopta.sensor.sampling.streams import generator
from megalopta.sensor.sampling.words import LANES, fill_words, word_streams
from megalopta.sensor.spad.frames import over_frames
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.rates import checked_rate
from megalopta.sensor.spad.running import running_counts

# Times a word of eight bytes of 0 or 1: these bits in the highest byte, the first one on top.
_GATHER = np.uint64(0x8040201008040201)

_OPEN = np.uint8(2)
"""Instead of a bit that is not decided yet."""
_ANY_OPEN = np.uint64(0x0202020202020202)
_LOTS = np.float32(65536)
# Of p·2¹⁶ in single precision, twice its error; a lot this far from both ends of it is decided.
_MARGIN = np.float32(2 * CHANCE_ERROR * 65536)
_CERTAIN = np.float32(1) + _MARGIN

_LANES_AT_ONCE = 128
"""Random words are made 16 kB at a time, which stay in the processor's first cache."""


def expose_binary(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
    free_running: bool | FreeRunning = False,
    threads: int | None = None,
) -> NDArray[np.uint8]:
    """Draw packed binary frames, (T, H, ceil(W/8)) uint8; parameters as for `expose_rate`.

    Of an array that runs freely they are the events of `expose_events`, one or more.

    Raises
    ------
    ValueError
        When the rate is impossible, or the first event of a pixel depends on more than its rate:
        with crosstalk, or with dead time and a stationary start.
    """
    check_binary(sensor)
    rate, device = checked_rate(detections_hz, sensor)
    if array := running_array(free_running, sensor.avalanche_effects):
        fired = np.empty((rate.shape[0], *rate.shape[-2:]), np.bool_)
        for frame, each in enumerate(rate):
            key = sequence, first_frame + frame
            fired[frame] = running_counts(array, each, sensor, device, seed, key) > 0
        return np.packbits(fired, axis=-1)
    if rate.ndim == 4:
        weights = part_weights(sensor.gate, sensor.exposure_s, rate.shape[1])
        rate = np.tensordot(weights, rate, (0, 1))
    open_s = sensor.exposure_s * open_fraction(sensor.gate, sensor.exposure_s)
    frames, rows, columns = rate.shape
    dark_hz = np.full((rows, columns), device.dark_counts_hz)
    packed = np.empty((frames, rows, -(-columns // 8)), np.uint8)

    def expose_frame(frame: int) -> None:
        streams = word_streams(generator(seed, "binary", sequence, first_frame + frame))
        _pack(streams, np.ascontiguousarray(rate[frame]), dark_hz, open_s, packed[frame])

    over_frames(expose_frame, frames, threads)
    return packed


def draw_binary(rng: np.random.Generator, means: Floats) -> NDArray[np.uint8]:
    """Draw one packed binary frame.

    Parameters
    ----------
    rng : numpy.random.Generator
    means : (rows, columns) float64
        Mean number of events in the time open; a bit is 1 with probability 1 − e^(−mean).

    Returns
    -------
    (rows, ceil(columns/8)) uint8
    """
    rows, columns = means.shape
    packed = np.empty((rows, -(-columns // 8)), np.uint8)
    dark_hz, means = np.zeros(means.shape), np.ascontiguousarray(means, np.float64)
    _pack(word_streams(rng), means, dark_hz, 1.0, packed)
    return packed


def unpack(packed: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Bits, 0 or 1, (…, H, width), of packed frames."""
    return np.unpackbits(packed, axis=-1, count=width)


def check_binary(sensor: Sensor) -> None:
    """Make sure that a sensor has binary frames: the first event depends on nothing but the rate.

    Raises
    ------
    ValueError
        With crosstalk, or with dead time or afterpulses and a stationary start.
    """
    if sensor.crosstalk.is_on:
        raise ValueError(
            f"crosstalk.mean_fired_neighbors: {sensor.crosstalk.mean_fired_neighbors:g}; binary "
            "frames have none: switch it off, or use a counter of capacity 1 with expose_rate"
        )
    if sensor.dead_time.start == "stationary" and sensor.avalanche_effects.remembers:
        raise ValueError(
            "dead_time.start: 'stationary'; binary frames start live: choose 'live', or use a "
            "counter of capacity 1 with expose_rate"
        )


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _pack(
    streams: NDArray[np.uint64],
    rate_hz: Floats,
    dark_hz: Floats,
    open_s: float,
    packed: NDArray[np.uint8],
) -> None:
    rows, columns = rate_hz.shape
    bits = np.zeros(8 * packed.shape[1], np.uint8)
    eights = bits.view(np.uint64)
    means = np.empty(columns, np.float32)
    lanes = -(-columns // (4 * LANES))
    at_once = max(1, _LANES_AT_ONCE // lanes)
    words = np.empty((at_once * lanes, LANES), np.uint64)
    all_lots = words.reshape(-1).view(np.uint16).reshape(at_once, -1)
    for row in range(rows):
        if row % at_once == 0:
            fill_words(streams, words)
        lots = all_lots[row % at_once]
        # No branches and one array each: these loops become vector instructions, and the second
        # one of twice the width, as it has nothing in double precision.
        for column in range(columns):
            means[column] = (rate_hz[row, column] + dark_hz[row, column]) * open_s
        for column in range(columns):
            above = _LOTS * chance(means[column]) - np.float32(np.int32(lots[column]))
            bits[column] = _OPEN * (above > -_MARGIN) - (above >= _CERTAIN)
        seen = np.uint64(0)
        for byte in range(eights.size):
            seen |= eights[byte]
        if seen & _ANY_OPEN:
            _settle(streams, rate_hz[row], dark_hz[row], open_s, lots, bits)
        for byte in range(eights.size):
            packed[row, byte] = (eights[byte] * _GATHER) >> np.uint64(56)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _settle(
    streams: NDArray[np.uint64],
    rate_hz: Floats,
    dark_hz: Floats,
    open_s: float,
    lots: NDArray[np.uint16],
    bits: NDArray[np.uint8],
) -> None:
    """Draw the bits that single precision leaves open."""
    words = np.empty((1, LANES), np.uint64)
    for column in range(rate_hz.size):
        if bits[column] == _OPEN:
            mean = (rate_hz[column] + dark_hz[column]) * open_s
            fill_words(streams, words)
            uniform = (words[0, 0] >> np.uint64(11)) * 2.0**-53
            bits[column] = uniform < -np.expm1(-mean) * 65536.0 - lots[column]
