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

from megalopta.sensor.exposure import checked_rate, over_frames
from megalopta.sensor.gating import open_fraction
from megalopta.sensor.model import Sensor
from megalopta.sensor.randomness import generator

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
        p = -np.expm1((rate[frame] + device.dark_counts_hz) * -open_s)
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
            f"crosstalk.probability: {sensor.crosstalk.probability:g}; binary frames have no "
            "crosstalk: switch it off, or use a counter of capacity 1 with expose_rate"
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
    for row in range(rows):
        for byte in range(packed.shape[1]):
            first = 8 * (row * packed.shape[1] + byte)
            bits = 0
            for place in range(min(8, columns - 8 * byte)):
                threshold = p[row, 8 * byte + place] * 65536.0
                whole, drawn = int(threshold), int(lots[first + place])
                if drawn == whole:
                    drawn -= rng.random() < threshold - whole
                bits |= (drawn < whole) << (7 - place)
            packed[row, byte] = bits
