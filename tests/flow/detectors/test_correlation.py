"""EMD, NDM and NDS on moving sinusoids against their closed forms, Eqs. 4.1 to 4.4 (4.3 corrected).

The sequences are ½(1 + C sin(ωt + jφ)); a mean over 2900 frames and 10 columns leaves less than
0.1 % of the ripple, so 1 % is a wide tolerance.
"""

import numpy as np
import pytest

from megalopta.flow.detectors.correlation import (
    ElementaryMotionDetector,
    NonDirectionalMultiplication,
    NonDirectionalSummation,
    ndm_mean,
    nds_mean,
)
from megalopta.flow.detectors.registry import METHODS

CONTRAST = 0.8
DETECTORS = [ElementaryMotionDetector(), NonDirectionalMultiplication(), NonDirectionalSummation()]
WAVES = [(0.7, -0.4), (0.31, -1.1), (1.9, -0.2), (0.7, 0.9)]


def sinusoid(omega, phase, frames=3000, contrast=CONTRAST):
    t, j = np.arange(frames)[:, None, None], np.arange(12)
    return np.broadcast_to(0.5 * (1 + contrast * np.sin(omega * t + j * phase)), (frames, 3, 12))


def filters(a, omega):
    """|high-pass|, |low-pass| and phase of the low-pass."""
    z = np.exp(-1j * omega)
    high, low = (1 - a) * (1 - z) / (1 - (1 - a) * z), a / (1 - (1 - a) * z)
    return abs(high), abs(low), np.angle(low)


def mean_response(detector, frames):
    return detector.respond(frames)[100:, 1:-1, 1:-1].mean()


@pytest.mark.parametrize(("omega", "phase"), WAVES)
def test_emd_mean_is_equation_4_1(omega, phase):
    emd = ElementaryMotionDetector()
    h1, h2, delay = filters(emd.filter_step, omega)
    expected = CONTRAST**2 / 4 * h1**2 * h2 * np.sin(delay) * np.sin(phase)
    assert mean_response(emd, sinusoid(omega, phase)) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("omega", "phase"), [*WAVES, (-0.63, 0.9), (0.92, 0.4), (-2.36, 0.196)])
@pytest.mark.parametrize(
    ("detector", "closed_form"),
    [(NonDirectionalMultiplication(rectified=False), ndm_mean), (NonDirectionalSummation(), nds_mean)],
)  # fmt: skip
def test_means_are_equations_4_2_and_the_corrected_4_3(detector, closed_form, omega, phase):
    expected = closed_form(detector.filter_step, omega, phase, CONTRAST)
    assert mean_response(detector, sinusoid(omega, phase)) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("omega", "phase"), WAVES)
def test_ndm_mean_is_that_of_a_rectified_sinusoid_with_offset(omega, phase):
    # The product is m + r cos(2ωt + …) with m/r = cos(delay) <= 1, and
    # E|m + r cos θ| = (2/π)(m·asin(m/r) + √(r² − m²)).
    ndm = NonDirectionalMultiplication()
    h1, h2, delay = filters(ndm.filter_step, omega)
    r = CONTRAST**2 / 4 * h1**2 * h2 * abs(np.cos(phase))
    expected = 2 / np.pi * r * (np.cos(delay) * (np.pi / 2 - abs(delay)) + abs(np.sin(delay)))
    assert mean_response(ndm, sinusoid(omega, phase)) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("detector", [*DETECTORS, METHODS["BM"], METHODS["PPM"]])
@pytest.mark.parametrize("seen", [0, 9])
def test_a_detector_that_starts_after_frames_goes_on_as_one_that_saw_them(detector, seen):
    frames = np.random.default_rng(3).poisson(5, (seen + 4, 30, 30)).astype(float)
    start = detector.after(frames[:seen], 2.0)
    for offset in (0.0, 30.0):  # each begins anew
        respond = detector.start((30, 30))
        if seen:
            respond(2 * frames[:seen] + offset, 1.0)
        expected = respond(2 * frames[seen:] + offset, 1.0)
        found = start(offset)(2 * frames[seen:] + offset, 1.0)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("detector", DETECTORS)
def test_of_one_bright_frame_1_percent_is_left_after_the_memory(detector):
    low = delayed = smoothed = 0.0
    responses = []
    for pixel in [1.0, *np.zeros(300)]:
        low += detector.filter_step * (pixel - low)
        delayed += detector.filter_step * (pixel - low - delayed)
        smoothed += detector.output_step * (delayed - smoothed)
        responses.append(abs(smoothed))
    for power, frames in ((1, detector.memory_frames), (2, detector.noise_memory_frames)):
        share = np.array(responses) ** power
        share /= share.sum()
        assert share[frames:].sum() < 0.01 <= share[frames - 1 :].sum()
