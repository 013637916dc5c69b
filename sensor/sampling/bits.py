"""Packed bits, 1 for at least one event of a Poisson number, drawn fast.

16 random bits are compared with p·2¹⁶, with p = 1 − exp(−mean) in single precision. In the two
cases in 65536 where this is undecided, a further uniform number is compared with the rest of the
exact p. Draws are exact to the last bit of p, at a quarter of a random word per pixel.
"""

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor.sampling.words import LANES, fill_words

CHANCE_ERROR = 2e-6
"""Error bound of `chance`; the largest error found is 1.2e-6."""

_LARGEST_MEAN = np.float32(16)

# Minimax polynomial of e^(−y), 0 ≤ y ≤ 1: error 3e-8 in exact arithmetic.
_C = np.polynomial.chebyshev.Chebyshev.interpolate(lambda y: np.exp(-y), 6, [0, 1])
_C0, _C1, _C2, _C3, _C4, _C5, _C6 = map(np.float32, _C.convert(kind=np.polynomial.Polynomial).coef)

# Multiplier that collects eight bytes of 0 or 1 in the highest byte, the first one on top.
_GATHER = np.uint64(0x8040201008040201)

_OPEN = np.uint8(2)
"""Placeholder for an undecided bit."""
_ANY_OPEN = np.uint64(0x0202020202020202)
_LOTS = np.float32(65536)
# Twice the error of p·2¹⁶ in single precision; a draw this far from both ends is decided.
_MARGIN = np.float32(2 * CHANCE_ERROR * 65536)
_CERTAIN = np.float32(1) + _MARGIN

_LANES_AT_ONCE = 128
"""Random words are made 16 kB at a time, to stay in the first-level cache."""


def unpack(packed: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Bits, 0 or 1, (…, H, width), of packed frames."""
    return np.unpackbits(packed, axis=-1, count=width)


@compiled
def fill_bits(
    streams: NDArray[np.uint64],
    rate_hz: Floats,
    more_hz: Floats,
    open_s: float,
    packed: NDArray[np.uint8],
) -> None:
    """Draw one frame of bits, packed along the width as by `np.packbits`.

    `streams`: `word_streams`; `rate_hz`, `more_hz` (rows, columns): the mean number of events is
    (rate_hz + more_hz)·open_s; `packed` (rows, ceil(columns/8)): output.
    """
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
        # No branches and one array each: these loops become vector instructions, the second one
        # twice as wide, as it has nothing in double precision.
        for column in range(columns):
            means[column] = (rate_hz[row, column] + more_hz[row, column]) * open_s
        for column in range(columns):
            above = _LOTS * chance(means[column]) - np.float32(np.int32(lots[column]))
            bits[column] = _OPEN * (above > -_MARGIN) - (above >= _CERTAIN)
        seen = np.uint64(0)
        for byte in range(eights.size):
            seen |= eights[byte]
        if seen & _ANY_OPEN:
            _settle(streams, rate_hz[row], more_hz[row], open_s, lots, bits)
        for byte in range(eights.size):
            packed[row, byte] = (eights[byte] * _GATHER) >> np.uint64(56)


@compiled
def _settle(
    streams: NDArray[np.uint64],
    rate_hz: Floats,
    more_hz: Floats,
    open_s: float,
    lots: NDArray[np.uint16],
    bits: NDArray[np.uint8],
) -> None:
    """Draw the bits that single precision leaves undecided."""
    words = np.empty((1, LANES), np.uint64)
    for column in range(rate_hz.size):
        if bits[column] == _OPEN:
            mean = (rate_hz[column] + more_hz[column]) * open_s
            fill_words(streams, words)
            uniform = (words[0, 0] >> np.uint64(11)) * 2.0**-53
            bits[column] = uniform < -np.expm1(-mean) * 65536.0 - lots[column]


@compiled(inline="always")
def chance(mean: np.float32) -> np.float32:
    """Probability of at least one of `mean` expected events; error below `CHANCE_ERROR`.

    1 − e^(−m) for m up to 16, 1 beyond: e^(−m/16) by a polynomial of degree 6, squared four times.
    Without branches and tables, a loop over pixels vectorizes in single precision.
    """
    y = min(mean, _LARGEST_MEAN) * np.float32(1 / 16)
    e = _C0 + y * (_C1 + y * (_C2 + y * (_C3 + y * (_C4 + y * (_C5 + y * _C6)))))
    e *= e
    e *= e
    e *= e
    e *= e
    return np.float32(1) - e
