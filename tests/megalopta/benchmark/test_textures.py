"""What the two methods of our own promise: photons against the bound, variance against the bound.

A sequence has 64 blocks. Everything is drawn from fixed seeds. Over other textures photons scatter by
half, as the bound does, their quotient by a tenth, efficiencies by 0.05; the limits asserted are
those of the claims.
"""

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from megalopta.benchmark import textures
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.translation_bound import fisher_information


@pytest.fixture(scope="module")
def clean():
    return textures.sequences(count=3)


@pytest.fixture(scope="module")
def entries(clean):
    chosen = {name: METHODS[name] for name in ("BM", "NDS", "PPM", "PM")}
    return {each.detector.name: each for each in textures.ranked(clean[:1], chosen)}


@pytest.mark.slow
def test_methods_with_velocities_are_ranked_by_photons_as_the_bound_promises(entries):
    assert list(entries) == ["PPM", "PM", "BM"]
    pooled, two, blocks = (entries[name].needed.photons for name in entries)
    known = entries["PM"].bounds.known
    assert 1 < two / known < 4
    assert entries["PPM"].frames == 8
    assert pooled < min(two / 2, 2 * known)
    assert blocks > 2 * two


@pytest.mark.slow
def test_variance_is_within_a_factor_of_two_of_the_bound(clean):
    found = textures.efficiencies(clean, METHODS["PM"], (3e5, 1e6, 1e7), draws=12)
    assert min(found) > 0.5
    assert max(found) < 1.05


def test_frames_hold_one_photon_share_each_and_drift_to_the_right(clean):
    np.testing.assert_allclose(clean.sum(axis=(2, 3)), 1)
    velocities = METHODS["PM"].respond(textures.leaf_counts(clean[0], 1e8, 0))
    assert np.median(velocities[..., 0]) == pytest.approx(textures.SPEED_PX, abs=0.03)
    assert np.median(velocities[..., 1]) == pytest.approx(0, abs=0.01)


def test_information_of_a_block_is_that_of_its_sum_and_a_margin_adds_that_of_its_pixels(clean):
    light = clean[:1]
    expected = fisher_information(light[0, -1], textures.GRID)[1:-1, 1:-1]
    np.testing.assert_allclose(textures.information(light)[0], expected, rtol=1e-9)
    # a margin of a whole block makes 3 × 3 blocks of each
    around = sliding_window_view(
        fisher_information(light[0, -1], textures.GRID), (3, 3), axis=(0, 1)
    ).sum(axis=(-2, -1))
    wide = textures.information(light, textures.GRID.block_px)[0]
    np.testing.assert_allclose(wide, around, rtol=1e-9, atol=1e-9 * around.max())
