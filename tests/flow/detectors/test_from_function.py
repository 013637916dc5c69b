"""Detectors from functions, sums of frames before them, and the blocks of all."""

import numpy as np
import pytest

from megalopta.flow import METHODS, BenchmarkSettings, detector_from, photon_benchmark
from megalopta.flow.detectors.blocks import BlockGrid, between_blocks, summed_frames
from megalopta.flow.detectors.gray_detector import FunctionDetector
from megalopta.flow.detectors.registry import detector_at


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


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda a, b: 1 / 0, "method mine: .*Error: .*two frames"),
        (lambda a, b: a, r"mine: a flow of shape \(48, 48\); give \(48, 48, 2\)"),
    ],
)
def test_a_function_that_fails_is_told_with_its_name(wrong, told):
    frames = np.random.default_rng(0).poisson(5, (2, 48, 48))
    with pytest.raises(ValueError, match=told):
        detector_from(wrong, "mine").dense(*frames)


def seen(first, second):
    """Tells the mean gray levels of both frames in the place of a velocity."""
    return np.broadcast_to((first.mean(), second.mean()), (*first.shape, 2))


def test_both_sums_hold_half_of_the_frames_each():
    counts = np.random.default_rng(0).poisson(4.0, (8, 30, 30)).astype(np.uint16)
    method = detector_from(seen)
    found = summed_frames(method).respond(counts)
    for index in range(7):
        half = min(index + 2, 8) // 2
        window = counts[: index + 2].astype(float)
        sums = np.stack((window[-2 * half : -half].sum(axis=0), window[-half:].sum(axis=0)))
        np.testing.assert_allclose(found[index], method.respond(sums)[0] / half)


def test_a_function_of_counts_gets_them_unscaled():
    counts = np.random.default_rng(0).poisson(4.0, (2, 30, 30)).astype(np.uint16)

    class OfCounts(FunctionDetector, frozen=True):
        takes_counts = True

    expected = counts.mean(axis=(1, 2))
    for detector in (
        detector_from(seen, counts=True),
        OfCounts(name="own", label="own", function=seen),
        detector_at(f"{__name__}:seen counts"),
    ):
        np.testing.assert_allclose(detector.dense(*counts)[0, 0], expected)
        np.testing.assert_allclose(detector.respond(counts, 1e-3)[0, 1, 1], expected)
    gray, photons = (detector_from(seen, counts=each).model_dump_json() for each in (0, 1))
    assert gray != photons  # or stored velocities would be mixed up


def singular(first, second):
    return np.linalg.inv(np.zeros(first.shape))


def test_a_crash_names_the_line_of_the_function_not_of_numpy():
    line = singular.__code__.co_firstlineno + 1
    with pytest.raises(ValueError, match=rf"test_from_function.py:{line};"):
        detector_from(singular).dense(*np.random.default_rng(0).poisson(4.0, (2, 30, 30)))


def test_stretch_is_anscombes_root():
    counts = np.random.default_rng(0).poisson(4.0, (2, 30, 30)).astype(np.uint16)
    stretched = detector_from(seen).model_copy(update={"stretch": "anscombe"})
    roots = 2 * np.sqrt(counts + 3 / 8)
    expected = (roots - roots.min()) / np.ptp(roots)
    found = stretched.respond(counts)[0, 1, 1]
    np.testing.assert_allclose(found, expected.mean(axis=(1, 2)))


def test_denoising_removes_noise_and_keeps_an_edge():
    """Of a step from 20 to 60 photons, 6.6 in roots, whose noise is 1."""
    light = np.repeat(np.repeat((20.0, 60.0), 20)[np.newaxis], 40, axis=0)
    counts = np.random.default_rng(0).poisson(np.stack((light, light)))

    def halves(stretch):
        pair = detector_from(lambda *pair: np.dstack(pair))
        flow = pair.model_copy(update={"stretch": stretch}).dense(*counts)
        sides = flow[4:-4, 4:16], flow[4:-4, 24:-4]
        step = np.mean(sides[1]) - np.mean(sides[0])
        return max(side.std() for side in sides) / step

    noise, left = halves("anscombe"), halves("denoised")
    np.testing.assert_allclose(noise, 1 / 6.6, rtol=0.1)
    assert left < noise / 3


@pytest.mark.parametrize(("name", "most"), [("BM", 2), ("PPM", 8)])
def test_a_method_refuses_more_frames_than_it_takes_together(name, most):
    frames = np.random.default_rng(0).poisson(9, (9, 40, 50))
    assert METHODS[name].dense(*frames[:most]).shape == (40, 50, 2)
    with pytest.raises(ValueError, match=f"9 frames: {name} takes 2"):
        METHODS[name].dense(*frames)
    with pytest.raises(ValueError, match="1 frames"):
        METHODS[name].dense(frames[0])


def test_between_blocks_velocities_are_linear_and_where_there_is_none_undefined():
    grid = BlockGrid((22, 30), 5)  # 4 × 6 blocks, one row of pixels above them
    x, y = np.moveaxis(grid.centers, -1, 0)
    flow = between_blocks(np.stack((2 * x - y, y), axis=-1), grid)
    rows, columns = (np.mgrid[:22, :30] + 0.5)[:, 4:18, 3:27]
    np.testing.assert_allclose(flow[4:18, 3:27, 0], 2 * columns - rows, atol=1e-12)
    np.testing.assert_allclose(flow[4:18, 3:27, 1], rows, atol=1e-12)
    np.testing.assert_allclose(flow[0], flow[3], atol=1e-12)
    holed = np.ones((4, 6, 2))
    holed[1, 2] = np.nan
    undefined = np.isnan(between_blocks(holed, grid)).any(axis=-1)
    assert undefined.sum() == 25 and undefined[6:11, 10:15].all()
    assert np.isnan(between_blocks(np.full((4, 6, 2), np.nan), grid)).all()
