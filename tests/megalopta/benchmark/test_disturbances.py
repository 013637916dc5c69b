"""Disturbances against their closed forms."""

import numpy as np
import pytest

from megalopta.benchmark.clips import FlowClip
from megalopta.benchmark.disturbances import AMOUNTS, disturbance, disturbed_means

MEANS = np.full((2, 180, 240), 10.0)


def disturbed(name, means=MEANS):
    return disturbed_means(means, disturbance(name), np.random.default_rng(0))


@pytest.mark.parametrize("name", ["ramp", "vignette", "shadow"])
def test_uneven_light_changes_the_second_frame_only_and_smoothly(name):
    first, second = disturbed(name)
    np.testing.assert_array_equal(first, MEANS[0])
    assert np.abs(second - first).max() > 1
    # the steepest is the middle of the edge of the shadow: 0.4·40/(√(2π)·240) of 10 a px, and cut
    # off where the Gaussian is small, as SciPy does (2 %)
    steepest = 0.4 * 10 * 40 / (np.sqrt(2 * np.pi) * 240)
    assert np.abs(np.diff(second, axis=1)).max() < 1.02 * steepest


def test_ramp_and_vignette_have_their_closed_forms():
    np.testing.assert_allclose(disturbed("ramp 20")[1, :, [0, -1]].T, np.tile([8, 12], (180, 1)))
    gain = disturbed("vignette 15")[1] / 10
    # in the middle of the frame, and at its right edge (x = 1/2)
    np.testing.assert_allclose(gain[90, 119:121].mean(), (1 + 1.5 * 0.15**2) ** -2, rtol=1e-3)
    edge = ((1 + 1.5 * 0.25) / (1 + 1.5 * 0.35**2)) ** 2
    np.testing.assert_allclose(gain[90, -1], edge, rtol=1e-3)


def test_shadow_covers_a_third_of_the_frame_at_60_percent():
    gain = disturbed("shadow 40")[1] / 10
    assert gain.max() == pytest.approx(1) and gain.min() == pytest.approx(0.6)
    assert (gain < 0.8).mean() == pytest.approx(1 / 3, abs=0.01)


@pytest.mark.parametrize("factor", [2, 5])
def test_dispersed_counts_have_a_variance_of_d_times_their_mean(factor):
    """Of 86 400 pixels of mean 10 the standard errors are below 1 and 2 %; 5 σ."""
    clip = FlowClip("flat", MEANS / 10, np.zeros((180, 240, 2)))
    counts = clip.counts(10.0, 0, disturbance(f"dispersion {factor}")).astype(float)
    assert counts.mean() == pytest.approx(10, abs=5 * np.sqrt(10 * factor / counts.size))
    assert counts.var() == pytest.approx(10 * factor, rel=0.05)


@pytest.mark.parametrize(("name", "is_fixed"), [("mismatch 20", True), ("rendering 20", False)])
def test_gains_of_pixels_have_20_percent_rms(name, is_fixed):
    gains = disturbed(name) / 10
    assert gains.mean() == pytest.approx(1, abs=0.005)
    assert gains.std() == pytest.approx(0.2, abs=0.004)
    assert np.corrcoef(*gains.reshape(2, -1))[0, 1] == pytest.approx(float(is_fixed), abs=0.03)


def test_warm_clusters_are_the_same_in_both_frames_and_scale_with_light():
    extra = disturbed("warm 3") - 10
    np.testing.assert_array_equal(*extra)
    assert extra.max() == pytest.approx(30) and 0.02 < (extra[0] > 1).mean() < 0.1
    np.testing.assert_allclose(disturbed("warm 3", 5 * MEANS), 5 * (extra + 10))


def test_names_have_amounts_or_defaults():
    assert {str(disturbance(kind)) for kind in AMOUNTS} >= {"ramp 20", "dispersion 2", "warm 3"}
    assert disturbance("dispersion5") == disturbance(" dispersion 5 ") == ("dispersion", 5)
    for wrong in ("ramp 200", "dispersion 1", "rendering 0", "ramp -3"):
        with pytest.raises(ValueError, match=r"ramp|dispersion|rendering"):
            disturbance(wrong)
