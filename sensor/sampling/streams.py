"""Random streams named by purpose.

A stream is a function of its key alone, (seed, purpose, stream, frame, …), so results never
depend on the order of draws, on chunks or on the number of workers. The key is hashed (BLAKE2b, 256
bits) with the type and length of every part, so that (1, "1"), ("1", 1) and ("11",) are three
streams. The hash is the entropy of a NumPy SeedSequence. Seed 0 is an ordinary seed.

Noise drawn from one stream for two lights, or by two sensors, would be nearly the same. So
exposures add to the name of their stream all settings of the sensor that change draws
(`sensor_stream`), and to a frame's its light (`light_key`).
"""

import hashlib
import operator
import re
from itertools import product
from typing import Any

import numpy as np
from pydantic import BaseModel
from scipy.special import ndtri

from megalopta.core.arrays import Floats

_TILE = 64
_AFTER_DRAWING: Any = {"name": True, "source": True, "jitter": True, "measured": {"stuck"},
                       "counter": {"calibrated"}}  # fmt: skip
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
