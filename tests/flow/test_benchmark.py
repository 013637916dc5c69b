"""The photon benchmark: known thresholds, calibrated standard errors, and independence of the way."""

import numpy as np
import pytest
import zarr

from megalopta.flow.benchmark import BenchmarkSettings, photon_benchmark
from megalopta.flow.detectors.registry import THESIS_METHODS, method

ALL = tuple(method(name) for name in THESIS_METHODS)


def grating(contrast=0.9, frames=40, size=120, cycles=5, step=3):
    """A plaid with a whole number of periods that moves right, seamless around the frame."""
    phase = 2 * np.pi * cycles * np.arange(size) / size
    image = 1 + contrast * np.sin(phase) * np.sin(phase[:, np.newaxis])
    return np.stack([np.roll(image, step * t, axis=1) for t in range(frames)])


def settings(**changes):
    base = {"sizes": (60,), "flux_min": 1e4, "flux_max": 1e7, "dark_counts": 0, "repeats": 2}
    return BenchmarkSettings(**(base | changes))


def measured(frames, methods, chosen, seed=0, sequence="grating"):
    return photon_benchmark(frames, methods, chosen, seed, sequence)


def test_a_still_scene_has_no_threshold_for_any_motion_detector():
    result = measured(grating(step=0, frames=20), ALL, settings(warm_up=5, flux_max=1e5))
    for curve in result.curves:
        assert (curve.thresholds[2].kind == "undefined") == (curve.method != "IM")


def test_results_do_not_depend_on_the_company_of_methods_sizes_and_fluxes():
    frames = grating(frames=20, size=60)
    many = measured(
        frames, ALL, settings(sizes=(30, 60), fluxes_per_decade=2, warm_up=13, metrics=("ratio",))
    )
    alone = measured(
        frames, [method("NDM")], settings(fluxes_per_decade=1, warm_up=13, metrics=("ratio",))
    )
    assert alone.curves[0].errors == many.curve("NDM", 60, "ratio").errors[::2]


def test_seed_and_name_of_the_sequence_each_give_other_draws():
    frames = grating(frames=20, size=60)
    results = [
        measured(frames, [method("IM")], settings(warm_up=0), seed, name).curves[0].errors
        for seed, name in ((0, "a"), (1, "a"), (0, "b"), (0, "a"))
    ]
    assert len(set(results)) == 3
    assert results[0] == results[3]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["EMD", "BM"])
def test_standard_error_is_the_scatter_between_seeds(name):
    # The frames of one draw depend on each other (the filters of EMD, the shared frame of two
    # pairs). Over 25 seeds and 4 fluxes the quotient of scatters is known within 10 %: 0.5 to
    # 1.5 is five times that.
    frames = grating(frames=36, size=60, cycles=6)[:, :30, :30]
    chosen = settings(sizes=(30,), fluxes_per_decade=1, metrics=("ratio",), bits=(2,), warm_up=16)
    curves = [measured(frames, [method(name)], chosen, seed).curves[0] for seed in range(25)]
    scatter = np.std([curve.errors for curve in curves], axis=0, ddof=1)
    promised = np.sqrt(np.mean(np.square([curve.standard_errors for curve in curves]), axis=0))
    seen = scatter > 0
    assert 0.5 < np.mean(promised[seen] / scatter[seen]) < 1.5


def test_dark_counts_are_given_per_pixel_of_the_original():
    # 10 dark counts on 120 × 120 are 40 on 60 × 60; with next to no light all error is theirs.
    chosen = settings(dark_counts=10, flux_min=1, flux_max=10, fluxes_per_decade=1, warm_up=0)
    curve = measured(np.ones((20, 120, 120)), [method("IM")], chosen).curve("IM", 60)
    # E|X − λ|/λ is 2 P(X = 40) at λ = 40.
    assert curve.errors[0] == pytest.approx(0.1259, rel=0.01)


@pytest.mark.parametrize(
    ("frames", "methods", "changes", "sentence"),
    [
        (np.ones((20, 50, 50)), ALL, {}, "size 60 × 60 px"),
        (np.ones((20, 60, 60)), ALL, {"sizes": (12,)}, "3 × 3 blocks"),
        (np.ones((10, 60, 60)), ALL, {}, "fewer than two to score after a warm_up of 20"),
        (np.zeros((40, 60, 60)), ALL, {}, "black"),
        (np.ones((20, 60, 60)), [], {}, "at least one"),
        (np.ones((20, 60, 60)), [method("IM")] * 2, {}, "a name of its own"),
    ],
)
def test_what_cannot_be_measured_is_refused_before_the_work(frames, methods, changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        measured(frames, methods, settings(**changes))


def test_neither_chunks_nor_the_place_of_frames_change_a_number(tmp_path, monkeypatch):
    frames = grating(frames=20, size=60)
    clip = zarr.create_array(tmp_path / "clip.zarr", data=frames, chunks=(4, 60, 60))
    base = {"warm_up": 5, "fluxes_per_decade": 1}
    expected = measured(frames, ALL, settings(**base))
    monkeypatch.setattr("megalopta.flow.benchmark.CHUNK_FRAMES", 7)
    found = measured(clip, ALL, settings(**base))
    assert found.curves == expected.curves
