import numpy as np

from megalopta.benchmark.ranking_errors import STRETCHES, Sums, units


def sums(errors):
    return Sums(np.asarray(errors, float), np.ones(len(errors)))


def test_a_unit_is_a_sequence():
    found = units([sums([1, 2]), sums([3]), sums([4]), sums([5, 5, 5]), sums([6])])
    assert found.errors.tolist() == [3, 3, 4, 15, 6]
    assert found.blocks.tolist() == [2, 1, 1, 3, 1]


def test_of_few_sequences_units_are_stretches():
    found = units([sums(np.arange(2 * STRETCHES)), sums([7, 8, 9])])
    assert found.errors[:3].tolist() == [1, 5, 9]
    assert found.errors[STRETCHES : STRETCHES + 3].tolist() == [7, 8, 9]
    assert found.errors.sum() == 2 * STRETCHES * (2 * STRETCHES - 1) / 2 + 24
    assert found.blocks.sum() == 2 * STRETCHES + 3
