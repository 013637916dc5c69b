import numpy as np

from megalopta.ranking.errors import PairSums, Replicates, joined


def sums(errors):
    return PairSums(np.asarray(errors, float), np.ones(len(errors)))


def test_interval_is_that_of_the_mean():
    """Over 300 samples of 60 pairs, 95 % of the intervals hold the true mean, 1, within 5 σ."""
    rng, held = np.random.default_rng(0), 0
    for _ in range(300):
        found = Replicates(60, 1).interval(sums(rng.normal(1, 0.3, 60)))
        held += found.low <= 1 <= found.high
    assert 300 * 0.95 - 5 * np.sqrt(300 * 0.95 * 0.05) < held


def test_a_common_difficulty_does_not_hide_a_difference():
    """Pairs differ by far more than the two methods, which differ in every pair."""
    rng = np.random.default_rng(0)
    hard = rng.exponential(1, 40)
    found = Replicates(40, 0).best({"a": sums(hard + 0.01), "b": sums(hard)})
    assert (found.method, found.is_sure) == ("b", True)


def test_methods_that_differ_by_noise_are_not_told_apart():
    """Of equals the better one is called sure in at most 1 of 10 cases (two-sided 95 %)."""
    rng = np.random.default_rng(0)
    sure = sum(
        Replicates(50, seed).best({"a": sums(a), "b": sums(b)}).is_sure
        for seed, (a, b) in enumerate(rng.normal(1, 0.2, (200, 2, 50)))
    )
    assert sure < 200 * 0.1 + 5 * np.sqrt(200 * 0.1 * 0.9)


def test_only_pairs_that_the_data_tell_apart_have_an_order():
    """b differs from a in every pair, c from b by noise alone (two-sided 95 %: here it is not)."""
    rng = np.random.default_rng(0)
    hard = rng.exponential(1, 40)
    noise = rng.normal(0, 0.01, 40)
    noise -= noise.mean()
    found = Replicates(40, 0).order(
        {"a": sums(hard + 0.1), "b": sums(hard), "c": sums(hard + noise), "d": sums(hard + 1)}
    )
    assert found == [("a", "d"), ("b", "a"), ("b", "d"), ("c", "a"), ("c", "d")]


def test_empty_groups_have_neither_mean_nor_best():
    empty = PairSums(np.zeros(5), np.zeros(5))
    assert Replicates(5, 0).interval(empty) is None
    assert Replicates(5, 0).best({"a": empty}) is None


def test_sequences_join_as_pairs():
    both = joined([sums([1, 2]), sums([3])])
    assert both.errors.tolist() == [1, 2, 3]
