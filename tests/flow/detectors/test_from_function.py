import numpy as np
import pytest

from megalopta.benchmark.trial import Trial
from megalopta.flow import METHODS, BenchmarkSettings, detector_from, method, photon_benchmark


def dense_inverse_search(first, second):
    return METHODS["DIS"].dense(first, second)


def to_the_right(first, second):
    return np.broadcast_to((2.0, 0.0), (*first.shape, 2))


@pytest.fixture(scope="module")
def frames():
    return np.random.default_rng(0).poisson(20, (4, 60, 60))


@pytest.mark.parametrize("name", ["DIS", "FB", "TV-L1", "PF"])
def test_blocks_are_means_of_the_dense_flow(frames, name):
    detector = METHODS[name]
    flow = detector.dense(*frames[:2])
    assert flow.shape == (60, 60, 2)
    means = flow.reshape(10, 6, 10, 6, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(detector.respond(frames[:2])[0], means, rtol=1e-12, atol=1e-12)


def test_a_function_answers_as_the_detector_that_it_wraps(frames):
    wrapped = method(dense_inverse_search)
    assert (wrapped.name, wrapped.gives) == ("dense_inverse_search", "velocity")
    np.testing.assert_array_equal(wrapped.respond(frames), METHODS["DIS"].respond(frames))


def test_a_function_is_measured_beside_names(frames):
    settings = BenchmarkSettings(
        sizes=(60,), flux_min=1e5, flux_max=1e6, fluxes_per_decade=1, repeats=2
    )
    result = photon_benchmark(frames, ["dis", dense_inverse_search], settings, 0, "noise")
    known, ours = (result.curve(name, 60) for name in ("DIS", "dense_inverse_search"))
    assert known.errors == ours.errors
    assert result.to_dict()["methods"]["dense_inverse_search"]["function"].startswith(__name__)


def test_functions_of_another_source_or_enclosed_value_are_other_detectors():
    def moved(way):
        return lambda first, second: np.full((*first.shape, 2), way)

    dumped = {
        detector_from(each, "same").model_dump_json()
        for each in (to_the_right, dense_inverse_search, moved(1), moved(2), moved(2))
    }
    assert len(dumped) == 4


def test_a_flow_of_another_shape_is_refused(frames):
    with pytest.raises(ValueError, match=r"wrong: a flow of shape \(60, 60\); give \(60, 60, 2\)"):
        detector_from(lambda first, second: first, "wrong").respond(frames)


def test_one_name_for_two_detectors_is_refused():
    with pytest.raises(ValueError, match="LK is named twice"):
        Trial(methods=["LK", detector_from(to_the_right, "LK")])


@pytest.mark.parametrize("wrong", [lambda pair: pair, lambda a, b: 1 / 0, lambda a, b: "x"])
def test_a_function_that_fails_is_told_with_its_name(wrong):
    frames = np.random.default_rng(0).poisson(5, (2, 48, 48))
    with pytest.raises(ValueError, match="method mine: .*Error: .*two frames"):
        detector_from(wrong, "mine").dense(*frames)
