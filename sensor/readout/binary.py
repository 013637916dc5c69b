"""Binary frames: whether a pixel saw anything during a short exposure, one bit each.

The bit is 1 with probability 1 − exp(−r·T) from a live start, whatever the dead time and the
afterpulses, which come after the first event; mean p, variance p·(1−p). Gated, T is the time open.
Bits are drawn by comparing 16 random bits with p·2¹⁶ and, in the one case in 65536 in which they
are equal, a further uniform number with the rest: exact to the last bit of p at a quarter of a
random word a pixel.

Packed as visionsim does: `np.packbits` along the width, most significant bit first, the last byte
of a row filled up with zeros.
"""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from megalopta.sensor.effects import open_fraction
from megalopta.sensor.sampling import generator
from megalopta.sensor.spad import Sensor, checked_rate, over_frames

# Times a word of eight bytes of 0 or 1: these bits in the highest byte, the first one on top.
_GATHER = np.uint64(0x8040201008040201)

Floats = NDArray[np.float64]


def expose_binary(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
    threads: int | None = None,
) -> NDArray[np.uint8]:
    """Draw packed binary frames, (T, H, ceil(W/8)) uint8; parameters as for `expose_rate`.

    Raises
    ------
    ValueError
        When the rate is impossible, or the first event of a pixel depends on more than its rate:
        with crosstalk, or with dead time and a stationary start.
    """
    _check_first_event(sensor)
    rate, device = checked_rate(detections_hz, sensor)
    open_s = sensor.exposure_s * open_fraction(sensor.gate, sensor.exposure_s)
    frames, rows, columns = rate.shape
    packed = np.empty((frames, rows, -(-columns // 8)), np.uint8)

    def expose_frame(frame: int) -> None:
        p = rate[frame] + device.dark_counts_hz
        p *= -open_s
        np.negative(np.expm1(p, out=p), out=p)
        packed[frame] = draw_binary(generator(seed, "binary", sequence, first_frame + frame), p)

    over_frames(expose_frame, frames, threads)
    return packed


def draw_binary(rng: np.random.Generator, p: Floats) -> NDArray[np.uint8]:
    """Draw one packed binary frame.

    Parameters
    ----------
    rng : numpy.random.Generator
    p : (rows, columns) float64
        Probability of a 1.

    Returns
    -------
    (rows, ceil(columns/8)) uint8
    """
    rows, columns = p.shape
    bytes_per_row = -(-columns // 8)
    words = rng.integers(0, 2**64, rows * bytes_per_row * 2, np.uint64, endpoint=False)
    packed = np.empty((rows, bytes_per_row), np.uint8)
    _pack(rng, np.ascontiguousarray(p, np.float64), words.view(np.uint16), packed)
    return packed


def unpack(packed: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Bits, 0 or 1, (…, H, width), of packed frames."""
    return np.unpackbits(packed, axis=-1, count=width)


def _check_first_event(sensor: Sensor) -> None:
    if sensor.crosstalk.is_on:
        raise ValueError(
            f"crosstalk.mean_fired_neighbors: {sensor.crosstalk.mean_fired_neighbors:g}; binary "
            "frames have none: switch it off, or use a counter of capacity 1 with expose_rate"
        )
    has_memory = sensor.dead_time.kind != "ideal" or sensor.afterpulsing.is_on
    if sensor.dead_time.start == "stationary" and has_memory:
        raise ValueError(
            "dead_time.start: 'stationary'; binary frames start live: choose 'live', or use a "
            "counter of capacity 1 with expose_rate"
        )


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _pack(
    rng: np.random.Generator,
    p: Floats,
    lots: NDArray[np.uint16],
    packed: NDArray[np.uint8],
) -> None:
    rows, columns = p.shape
    bits = np.zeros(8 * packed.shape[1], np.uint8)
    eights = bits.view(np.uint64)
    for row in range(rows):
        first = row * bits.size
        ties = 0
        # no branches and one array each: this loop becomes vector instructions
        for column in range(columns):
            whole = np.int32(p[row, column] * 65536.0)
            lot = np.int32(lots[first + column])
            bits[column] = lot < whole
            ties += lot == whole
        if ties > 0:
            _settle_ties(rng, p[row], lots[first : first + columns], bits)
        for byte in range(eights.size):
            packed[row, byte] = (eights[byte] * _GATHER) >> np.uint64(56)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _settle_ties(
    rng: np.random.Generator, p: Floats, lots: NDArray[np.uint16], bits: NDArray[np.uint8]
) -> None:
    for column in range(p.size):
        threshold = p[column] * 65536.0
        if lots[column] == int(threshold):
            bits[column] = rng.random() < threshold - int(threshold)
