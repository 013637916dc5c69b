"""Sums of frames before a method of two, and counts whose noise was made alike."""

import numpy as np

from megalopta.flow.detectors.from_function import detector_from
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.detectors.summed_frames import summed_frames

from ..textures import drifting_texture


def seen(first, second):
    """Tells the mean gray levels of both frames in the place of a velocity."""
    return np.broadcast_to((first.mean(), second.mean()), (*first.shape, 2))


def test_velocity_is_that_over_half_of_the_frames():
    frames = 1e4 * (3 + drifting_texture((0.6, -0.3), 8, (96, 96), blur_px=2.0))
    detector = summed_frames(METHODS["DIS"])
    assert detector.memory_frames == 7
    newest = detector.respond(frames)[-1, 2:-2, 2:-2]
    # DIS is right to about 0.1 px over the four frames
    np.testing.assert_allclose(newest.mean(axis=(0, 1)), (0.6, -0.3), atol=0.03)


def test_both_sums_hold_half_of_the_frames_each():
    counts = np.random.default_rng(0).poisson(4.0, (8, 30, 30)).astype(np.uint16)
    method = detector_from(seen)
    found = summed_frames(method).respond(counts)
    for index in range(7):
        half = min(index + 2, 8) // 2
        window = counts[: index + 2].astype(float)
        sums = np.stack((window[-2 * half : -half].sum(axis=0), window[-half:].sum(axis=0)))
        np.testing.assert_allclose(found[index], method.respond(sums)[0] / half)


def test_stretch_is_anscombes_root():
    counts = np.random.default_rng(0).poisson(4.0, (2, 30, 30)).astype(np.uint16)
    stretched = detector_from(seen).model_copy(update={"stretch": "anscombe"})
    roots = 2 * np.sqrt(counts + 3 / 8)
    expected = (roots - roots.min()) / np.ptp(roots)
    found = stretched.respond(counts)[0, 1, 1]
    np.testing.assert_allclose(found, expected.mean(axis=(1, 2)))
