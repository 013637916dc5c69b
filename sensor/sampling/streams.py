"""Random streams named by purpose.

A stream is a function of its key alone, (seed, purpose, sequence, frame, …), so results never
depend on the order of draws, on chunks or on the number of workers. The key is hashed (BLAKE2b, 256
bits) with the type and length of every part, so that (1, "1"), ("1", 1) and ("11",) are three
streams. The hash is the entropy of a NumPy SeedSequence. Seed 0 is an ordinary seed.
"""

import hashlib
import operator
from itertools import product

import numpy as np
from scipy.special import ndtri

from megalopta.core.arrays import Floats

_TILE = 64


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
            "number or text as sequence"
        ) from None
    body = text.encode()
    return f"{'s' if isinstance(part, str) else 'i'}{len(body)}:".encode() + body
