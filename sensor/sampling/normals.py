"""A standard normal number from a random word, faster than NumPy draws one inside compiled code.

The ziggurat of Marsaglia and Tsang (J. Stat. Softw. 5(8), 2000): 256 layers of equal area cover the
density; a word chooses a layer and a place in it, which lies under the density 99 times in 100. The
word's highest 53 bits choose the place and its lowest 8 the layer, which share no bit.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_LAYERS = 256
_TAIL = 3.6541528853610088
"""Where the tail begins that belongs to the lowest layer"""

_AREA = _TAIL * math.exp(-(_TAIL**2) / 2) + math.sqrt(math.pi / 2) * math.erfc(_TAIL / math.sqrt(2))


def _layer_edges() -> NDArray[np.float64]:
    """Width of each layer, the lowest first, whose tail is laid beside it; the last is 0."""
    edges = [_AREA / math.exp(-(_TAIL**2) / 2), _TAIL]
    while len(edges) < _LAYERS:
        height = math.exp(-(edges[-1] ** 2) / 2) + _AREA / edges[-1]
        edges.append(math.sqrt(-2 * math.log(height)))
    return np.array([*edges, 0.0])


_LAYER = np.uint64(_LAYERS - 1)
EDGES = _layer_edges()


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def quick_normal(word: np.uint64, edges: NDArray[np.float64]) -> float:
    """Return a standard normal number of a random word, or NaN where `slow_normal` is to be asked.

    Compiled code takes `EDGES` as an argument: as a constant it would be stored with each function.
    """
    layer = word & _LAYER
    z = _place(word) * edges[layer]
    return float(z) if abs(z) < edges[layer + np.uint64(1)] else math.nan


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def slow_normal(word: np.uint64, edges: NDArray[np.float64], rng: np.random.Generator) -> float:
    """Return the number that `quick_normal` leaves open."""
    layer = word & _LAYER
    z = _place(word) * edges[layer]
    if layer == 0:
        while True:  # Marsaglia's tail
            beyond = rng.standard_exponential() / _TAIL
            if 2 * rng.standard_exponential() > beyond * beyond:
                return math.copysign(_TAIL + beyond, z)
    lower = math.exp(-(edges[layer] ** 2) / 2)
    upper = math.exp(-(edges[layer + np.uint64(1)] ** 2) / 2)
    if lower + (upper - lower) * rng.random() < math.exp(-z * z / 2):
        return float(z)
    return rng.standard_normal()


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _place(word: np.uint64) -> float:
    """Place in a layer, within (−1, 1)."""
    return (float(np.int64(word) >> np.int64(11)) + 0.5) * 2.0**-52
