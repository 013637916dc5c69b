"""One random generator per purpose, so that adding a tree never changes the grass."""

from zlib import crc32

import numpy as np


def generator(seed: int, *purpose: str | int) -> np.random.Generator:
    """Return the generator that belongs to a seed, 0 or more, and to what is drawn.

    That is told from coarse to fine: ``generator(3, "tree", "beech", 2)``.
    """
    key = [crc32(part.encode()) if isinstance(part, str) else part for part in purpose]
    # The length comes first because numpy takes a seed's trailing zeros for padding.
    return np.random.default_rng([len(key), seed, *key])
