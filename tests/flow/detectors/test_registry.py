"""What every detector in the registry promises."""

import numpy as np
import pytest
from pydantic import ValidationError

from megalopta.flow.detectors.registry import METHODS, THESIS_METHODS, method
from megalopta.flow.metrics import rightward_evidence

from ..textures import drifting_texture

DETECTORS = [pytest.param(detector, id=name) for name, detector in METHODS.items()]
VELOCITY = [name for name, detector in METHODS.items() if detector.gives == "velocity"]


def counts(shape=(7, 30, 40), mean=4.0):
    return np.random.default_rng(0).poisson(mean, shape).astype(np.uint16)


def test_registry_holds_the_methods_under_their_names():
    assert THESIS_METHODS == ("BM", "IIA", "EMD", "NDM", "NDS", "IM")
    assert set(THESIS_METHODS) | {"LK", "FB", "DIS", "TV-L1", "PC", "PM", "PPM"} <= set(METHODS)
    assert all(name == detector.name for name, detector in METHODS.items())


def test_method_is_found_in_any_case():
    assert method("nds") is METHODS["NDS"]


def test_unknown_method_names_those_that_exist():
    with pytest.raises(ValueError, match=r"'lucas' is unknown: choose from BM, IIA, EMD"):
        method("lucas")


@pytest.mark.parametrize("detector", DETECTORS)
def test_response_has_the_documented_shape(detector):
    responses = detector.respond(counts())
    if detector.gives == "response":
        assert responses.shape == (7, 30, 40)
    else:
        grid = detector.grid((30, 40))
        assert responses.shape == (6, grid.rows, grid.columns, 2)
    assert responses.dtype == np.float64


@pytest.mark.parametrize("detector", DETECTORS)
@pytest.mark.parametrize("length", [1, 3, 7])
def test_response_does_not_depend_on_the_cutting_into_chunks(detector, length):
    frames = counts()
    whole = detector.respond(frames, 0.25)
    respond = detector.start((30, 40))
    parts = [respond(frames[first : first + length], 0.25) for first in range(0, 7, length)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize("detector", DETECTORS)
def test_scale_multiplies_the_frames_unless_they_must_be_counts(detector):
    frames = counts()
    scaled = frames if detector.takes_counts else frames * 0.125
    np.testing.assert_allclose(detector.respond(frames, 0.125), detector.respond(scaled), rtol=1e-9)


@pytest.mark.parametrize("detector", DETECTORS)
def test_offset_changes_the_response_exactly_when_the_detector_says_so(detector):
    frames = counts().astype(np.float64)
    same = np.allclose(
        detector.respond(frames + 8), detector.respond(frames), atol=1e-9, equal_nan=True
    )
    assert same == detector.ignores_offset


@pytest.mark.parametrize("detector", DETECTORS)
def test_frames_are_left_as_they_are(detector):
    frames = counts()
    detector.respond(frames)
    np.testing.assert_array_equal(frames, counts())


@pytest.mark.parametrize("detector", DETECTORS)
@pytest.mark.parametrize("shape", [(2, 2), (2, 50), (50, 2)])
def test_frames_too_small_are_refused_with_their_size(detector, shape):
    with pytest.raises(ValueError, match=f"{shape[0]} × {shape[1]} px"):
        detector.respond(np.ones((3, *shape)))


@pytest.mark.parametrize("detector", DETECTORS)
def test_a_single_image_is_refused(detector):
    with pytest.raises(ValueError, match=r"needs a sequence \(T, H, W\)"):
        detector.respond(np.ones((30, 30)))


@pytest.mark.parametrize("name", VELOCITY)
def test_velocity_needs_two_frames(name):
    with pytest.raises(ValueError, match="at least 2 frames"):
        METHODS[name].respond(np.ones((1, 30, 30)))


@pytest.mark.parametrize("detector", DETECTORS)
def test_parameters_survive_a_round_trip_and_nonsense_does_not(detector):
    assert type(detector).model_validate_json(detector.model_dump_json()) == detector
    with pytest.raises(ValidationError):
        type(detector)(speed=3)


@pytest.mark.parametrize(
    "name",
    [
        # dear, and their velocities have tests of their own
        pytest.param(name, marks=[pytest.mark.slow] if name in ("TV-L1", "PC", "PF", "PPF") else [])
        for name in METHODS
    ],
)
def test_detectors_that_tell_direction_answer_with_its_sign(name):
    detector = METHODS[name]
    texture = drifting_texture((1.3, 0.0), frames=detector.memory_frames + 4)
    frames = 1e4 * (1 + 0.25 * texture / texture.std()).clip(0)
    right, left = (
        np.mean(rightward_evidence(detector, detector.respond(each)[-3:]))
        for each in (frames, frames[..., ::-1])
    )
    assert (right > 0 > left) == detector.tells_direction
