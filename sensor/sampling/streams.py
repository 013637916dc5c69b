"""Random streams named by purpose, and their random words and normal numbers in bulk.

A stream is a function of its key alone, (seed, purpose, stream, frame, …), so results never
depend on the order of draws, on chunks or on the number of workers. The key is hashed (BLAKE2b, 256
bits) with the type and length of every part, so that (1, "1"), ("1", 1) and ("11",) are three
streams. The hash is the entropy of a NumPy SeedSequence. Seed 0 is an ordinary seed.

Noise drawn from one stream for two lights, or by two sensors, would be nearly the same. So
exposures add to the name of their stream all settings of the sensor that change draws
(`sensor_stream`), and to a frame's its light (`light_key`).

**Words**, faster than by NumPy: sixteen SFC64 generators (Chris Doty-Humphrey, PractRand) side by
side, as vector instructions. Their states, three random words each, come from a NumPy generator, so
they coincide only with a probability of 2⁻¹⁸⁴. Twelve rounds precede the first word, as in NumPy's
own.

**Normal numbers**: the ziggurat of Marsaglia and Tsang (J. Stat. Softw. 5(8), 2000): 1024 layers of
equal area cover the density; a word chooses a layer and a place in it, which lies under the density
997 times in 1000. The word's highest 53 bits choose the place and its lowest 10 the layer; no bit
is shared.
"""

import hashlib
import math
import operator
import os
import re
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel
from scipy.special import ndtri

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled

_TILE = 64
_AFTER_DRAWING: Any = {"name": True, "source": True, "assumed": True, "jitter": True,
                       "measured": {"stuck"}, "counter": {"calibrated"}}  # fmt: skip
"""Fields of a sensor that change what is made of a draw, not the draw"""
_GOLDEN = (5**0.5 - 1) / 2


def generator(seed: int, *key: str | int) -> np.random.Generator:
    """Return the random generator of one purpose.

    Raises TypeError if a part of the key is neither a string nor an integer.

    Parameters
    ----------
    seed : int
        The user's seed; any integer.
    *key : str or int
        Purpose of the stream, such as ("exposure", "forest-3", 17).
    """
    digest = hashlib.blake2b(b"".join(map(_encode, (seed, *key))), digest_size=32).digest()
    entropy = np.frombuffer(digest, "<u4")  # four times as fast as one large number
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(entropy)))


class Draw(NamedTuple):
    """Names of the random numbers of consecutive frames; parameters as for `expose`."""

    seed: int
    stream: str | int
    first_frame: int = 0
    frame_period_s: float | None = None


def sensor_stream(stream: str | int, sensor: BaseModel, dark_counts_hz: Floats) -> str:
    """Name of the draws of one sensor in a stream; those of other settings are unrelated.

    Places of its files are not part of it. `dark_counts_hz` (rows, columns): its own.
    Raises TypeError if the stream is neither a string nor an integer.
    """
    settings = sensor.model_dump_json(exclude=_AFTER_DRAWING)
    placeless = re.sub(r'"path":"(?:[^"\\]|\\.)*",?', "", settings)
    key = _encode(stream) + placeless.encode() + light_key(dark_counts_hz).encode()
    return hashlib.blake2b(key, digest_size=16).hexdigest()


def light_key(rates: Floats) -> str:
    """Name of the rates of a frame, of any shape, by a weighted mean of them to six digits.

    Rounding of their last digits, as on another processor, leaves it as it is.
    """
    total = np.asarray(rates, np.float64)
    for side in reversed(total.shape):
        total = total @ ((0.5 + _GOLDEN * np.arange(side)) % 1 + 0.5) / side
    return f"{float(total):.6g}"


def over_frames(task: Callable[[int], None], frames: Iterable[int], in_turn: bool = False) -> None:
    """Run a task for every frame number, in threads unless in turn.

    Each task must write to its own places.
    """
    numbers = list(frames)
    workers = min(os.cpu_count() or 1, len(numbers))
    if in_turn or workers <= 1:
        for frame in numbers:
            task(frame)
        return
    with ThreadPoolExecutor(workers) as pool:
        for _ in pool.map(task, numbers):
            pass


def pixel_uniforms(shape: tuple[int, int], seed: int, *key: str | int) -> Floats:
    """Return one number in [0, 1) per pixel, fixed by the key and the pixel's row and column.

    A smaller array is the top left corner of a larger one, so a device keeps its fixed pattern when
    fewer pixels are read.

    `shape` (rows, columns); `seed`, `*key`: as for `generator`.
    """
    rows, columns = shape
    field = np.empty((-(-rows // _TILE) * _TILE, -(-columns // _TILE) * _TILE))
    for top, left in product(range(0, rows, _TILE), range(0, columns, _TILE)):
        tile = generator(seed, *key, top // _TILE, left // _TILE).random((_TILE, _TILE))
        field[top : top + _TILE, left : left + _TILE] = tile
    return field[:rows, :columns]


def pixel_normals(shape: tuple[int, int], seed: int, *key: str | int) -> Floats:
    """Return a standard normal number per pixel (rows, columns), |z| < 8.3; as `pixel_uniforms`."""
    # 0 is a possible uniform number without a quantile; 1 is not
    return np.asarray(ndtri(np.maximum(pixel_uniforms(shape, seed, *key), 2.0**-54)))


def _encode(part: str | int) -> bytes:
    try:
        text = part if isinstance(part, str) else str(operator.index(part))
    except TypeError:
        raise TypeError(
            f"{part!r} cannot name random numbers; give a whole number as seed and frame, a whole "
            "number or text as stream"
        ) from None
    body = text.encode()
    return f"{'s' if isinstance(part, str) else 'i'}{len(body)}:".encode() + body


LANES = 16

_ROUNDS = 12


def word_streams(rng: np.random.Generator, *count: int) -> NDArray[np.uint64]:
    """Draw the state of a source of words for `fill_words`, (4, LANES), or (count, 4, LANES)."""
    states = np.ones((*count, 4, LANES), np.uint64)
    states[..., :3, :] = rng.bit_generator.random_raw((*count, 3, LANES))
    _pass_rounds(states.reshape(-1, 4, LANES))
    return states


@compiled
def fill_words(state: NDArray[np.uint64], words: NDArray[np.uint64]) -> None:
    """Fill (N, LANES) with random words and advance the state."""
    a, b, c, counter = state[0].copy(), state[1].copy(), state[2].copy(), state[3].copy()
    for step in range(words.shape[0]):
        for lane in range(LANES):
            word = a[lane] + b[lane] + counter[lane]
            counter[lane] += np.uint64(1)
            a[lane] = b[lane] ^ (b[lane] >> np.uint64(11))
            b[lane] = c[lane] + (c[lane] << np.uint64(3))
            c[lane] = ((c[lane] << np.uint64(24)) | (c[lane] >> np.uint64(40))) + word
            words[step, lane] = word
    state[0], state[1], state[2], state[3] = a, b, c, counter


@compiled
def uniform(word: np.uint64) -> float:
    """Return a number within (0, 1) from a random word."""
    return (float(word >> np.uint64(11)) + 0.5) * 2.0**-53


@compiled
def mixed(word: np.uint64) -> np.uint64:
    """Next word of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014)."""
    word = word + np.uint64(0x9E3779B97F4A7C15)
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@compiled
def _pass_rounds(states: NDArray[np.uint64]) -> None:
    words = np.empty((_ROUNDS, LANES), np.uint64)
    for state in states:
        fill_words(state, words)


_LAYERS = 1024
_TAIL = 4.0388498461095045
"""Start of the tail, which belongs to the lowest layer"""

_AREA = _TAIL * math.exp(-(_TAIL**2) / 2) + math.sqrt(math.pi / 2) * math.erfc(_TAIL / math.sqrt(2))


def _layer_edges() -> Floats:
    """Width of each layer, the lowest first with its tail next to it; the last is 0."""
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
    edges: Floats,
    numbers: Floats,
) -> None:
    """Fill (N,) with standard normal numbers.

    Each takes one word of the first streams, and one in some hundreds more from the others, so the
    first numbers do not depend on N. `words` (rows, LANES) is scratch space for N words. Compiled
    code takes `EDGES` as an argument: as a constant it would be stored with each function.
    """
    fill_words(streams, words[: -(-numbers.size // LANES)])
    word = words.reshape(-1)
    for k in range(numbers.size):
        layer = word[k] & _LAYER
        numbers[k] = _place(word[k]) * edges[layer]
        if abs(numbers[k]) >= edges[layer + _ONE]:
            numbers[k] = _slow_normal(more_streams, edges, layer, numbers[k])


@compiled
def _slow_normal(streams: NDArray[np.uint64], edges: Floats, layer: np.uint64, z: float) -> float:
    """Return the number for a place in a layer that may not lie under the density."""
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
