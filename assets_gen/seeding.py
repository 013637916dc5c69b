"""One random generator per purpose, so that adding a tree never changes the grass."""

from zlib import crc32

import numpy as np


def generator(seed: int, *purpose: str | int) -> np.random.Generator:
    """Return the generator for a seed, 0 or more, and a purpose.

    The purpose is given from coarse to fine: ``generator(3, "tree", "beech", 2)``.
    """
    key = [crc32(part.encode()) if isinstance(part, str) else part for part in purpose]
    # The length comes first because numpy treats a seed's trailing zeros as padding.
    return np.random.default_rng([len(key), seed, *key])
