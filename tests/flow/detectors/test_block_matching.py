"""Block matching against brute force in NumPy, and on motion that it can measure exactly."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from megalopta.flow.detectors.block_matching import BlockMatching
from megalopta.flow.detectors.blocks import thesis_radius_px

BENCHMARK = Path(__file__).parents[3] / "benchmarks" / "bench_flow.py"
brute_force = runpy.run_path(str(BENCHMARK))["numpy_block_matching"]


@pytest.mark.parametrize("dtype", [np.uint16, np.uint32, np.int64, np.float64])
@pytest.mark.parametrize(("mean", "block", "radius"), [(0.05, 6, 3), (1, 10, 4), (2000, 5, 7)])
def test_noise_full_of_ties_equals_brute_force(dtype, mean, block, radius):
    counts = np.random.default_rng(3).poisson(mean, (3, 60, 90)).astype(dtype)
    velocities = BlockMatching(block_px=block, radius_px=radius).respond(counts)
    for pair in range(2):
        expected = brute_force(counts[pair], counts[pair + 1], block, radius)
        np.testing.assert_array_equal(velocities[pair], expected)


def test_thesis_radii_are_the_default():
    assert [thesis_radius_px((n, n)) for n in (60, 120, 180, 240)] == [3, 4, 6, 7]
