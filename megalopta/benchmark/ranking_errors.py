"""Errors of all methods by group of blocks, summed over the units that intervals rest on.

A block's error is the endpoint error in px of the full image per frame; a block without velocity
counts as one that answered 0. Means are over all blocks of a group. Pixels and frames of one
sequence show the same things, so that a unit is a sequence; where there are too few of them, it is
a stretch of one, and what is found holds for these sequences alone.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.benchmark.sequence_truth import BlockTruths
from megalopta.core.arrays import Floats

STILL = "answer 0"
"""What a method must beat: no motion anywhere"""

FEWEST_SEQUENCES = 5
"""From so many on, sequences are the units"""

STRETCHES = 10
"""Of successive pairs of frames, into which each of fewer sequences is divided"""


class Sums(NamedTuple):
    """Sum of errors and number of blocks, of each pair of frames or each unit, (n,)."""

    errors: Floats
    blocks: Floats


def endpoint_errors(velocities: Floats, truth: BlockTruths) -> Floats:
    """Return the endpoint errors (pairs, rows, columns) of the blocks inside."""
    inside = velocities[:, 1:-1, 1:-1]
    answered = np.isfinite(inside).all(axis=-1, keepdims=True)
    return np.asarray(np.linalg.norm(np.where(answered, inside, 0) - truth.velocities, axis=-1))


def pair_sums(errors: Sequence[Floats], among: NDArray[np.bool_]) -> Sums:
    """Sum errors (pairs, rows, columns) of several draws over the blocks of a group."""
    total = np.sum([np.where(among, each, 0).sum(axis=(1, 2)) for each in errors], axis=0)
    return Sums(np.asarray(total), len(errors) * among.sum(axis=(1, 2)).astype(np.float64))


def units(sequences: Sequence[Sums]) -> Sums:
    """Sum over the pairs of each unit: each sequence, or each stretch of few sequences."""
    stretches = 1 if len(sequences) >= FEWEST_SEQUENCES else STRETCHES
    return Sums(
        *(
            np.array(
                [part.sum() for each in pairs for part in np.array_split(each, stretches)],
                np.float64,
            )
            for pairs in zip(*sequences, strict=True)
        )
    )
