"""Standard normal numbers from random words, faster than NumPy draws them.

The ziggurat of Marsaglia and Tsang (J. Stat. Softw. 5(8), 2000): 1024 layers of equal area cover
the density; a word chooses a layer and a place in it, which lies under the density 997 times in
1000. The word's highest 53 bits choose the place and its lowest 10 the layer, which share no bit.
"""

import math

import numpy as np
from numpy.typing import NDArray

from megalopta.core.compiling import compiled
from megalopta.sensor.sampling.words import LANES, fill_words, uniform

_LAYERS = 1024
_TAIL = 4.0388498461095045
"""Where the tail begins that belongs to the lowest layer"""

_AREA = _TAIL * math.exp(-(_TAIL**2) / 2) + math.sqrt(math.pi / 2) * math.erfc(_TAIL / math.sqrt(2))


def _layer_edges() -> NDArray[np.float64]:
    """Width of each layer, the lowest first, whose tail is laid beside it; the last is 0."""
    edges = [_AREA / math.exp(-(_TAIL**2) / 2), _TAIL]
    while len(edges) < _LAYERS:
        height = math.exp(-(edges[-1] ** 2) / 2) + _AREA / edges[-1]
        edges.append(math.sqrt(-2 * math.log(height)))
    return np.array([*edges, 0.0])


_LAYER, _ONE = np.uint64(_LAYERS - 1), np.uint64(1)
EDGES = _layer_edges()


@compiled
def fill_normals(
    streams: NDArray[np.uint64],
    more_streams: NDArray[np.uint64],
    words: NDArray[np.uint64],
    edges: NDArray[np.float64],
    numbers: NDArray[np.float64],
) -> None:
    """Fill (N,) with standard normal numbers.

    Each takes a word of the first streams, and one in some hundred more of the others: the first
    numbers of many are those of few. `words` (rows, LANES) is room for N words. Compiled code takes
    `EDGES` as an argument: as a constant it would be stored with each function.
    """
    fill_words(streams, words[: -(-numbers.size // LANES)])
    word = words.reshape(-1)
    for k in range(numbers.size):
        layer = word[k] & _LAYER
        numbers[k] = _place(word[k]) * edges[layer]
        if abs(numbers[k]) >= edges[layer + _ONE]:
            numbers[k] = _slow_normal(more_streams, edges, layer, numbers[k])


@compiled
def _slow_normal(
    streams: NDArray[np.uint64], edges: NDArray[np.float64], layer: np.uint64, z: float
) -> float:
    """Return the number of a place in a layer that may not lie under the density."""
    words = np.empty((1, LANES), np.uint64)
    while True:
        fill_words(streams, words)
        word = words[0]
        if layer == 0 and abs(z) >= _TAIL:  # Marsaglia's tail
            beyond = -math.log(uniform(word[0])) / _TAIL
            if -2 * math.log(uniform(word[1])) > beyond * beyond:
                return math.copysign(_TAIL + beyond, z)
            continue
        lower = math.exp(-(edges[layer] ** 2) / 2)
        upper = math.exp(-(edges[layer + _ONE] ** 2) / 2)
        if lower + (upper - lower) * uniform(word[0]) < math.exp(-z * z / 2):
            return z
        layer = word[1] & _LAYER
        z = _place(word[1]) * edges[layer]


@compiled
def _place(word: np.uint64) -> float:
    """Place in a layer, within (−1, 1)."""
    return (float(np.int64(word) >> np.int64(11)) + 0.5) * 2.0**-52
