"""The flow between two images in one call."""

import numpy as np
import pytest

from megalopta.flow import METHODS, BlockDetector, PoissonFlow, optical_flow

from .textures import drifting_texture

ABLE = [name for name, each in METHODS.items() if isinstance(each, BlockDetector)]
VELOCITY = (0.6, -0.3)

# Median error (px) over the middle of a texture of 1e4 photons per pixel. BM answers (1, 0), half a
# pixel off. PC weighs all frequencies alike, of which most hold noise; parabolas through absolute
# differences (BA) draw velocities toward whole pixels; zero is off by the shift. All others are within .06 px.
TOLERANCE_PX = {"BM": 0.5, "PC": 0.25, "BA": 0.15, "zero": 0.68}


@pytest.fixture(scope="module")
def pair():
    texture = drifting_texture(VELOCITY, 2, (96, 128), blur_px=2.0)
    light = (1 + 0.25 * texture / texture.std()).clip(0.05)
    return np.random.default_rng(0).poisson(1e4 * light)


@pytest.mark.parametrize("name", ABLE)
def test_every_method_tells_how_a_texture_is_shifted(name, pair):
    flow = optical_flow(*pair, name)
    assert flow.shape == (96, 128, 2) and np.isfinite(flow).all()
    error = np.hypot(*np.moveaxis(flow - VELOCITY, -1, 0))[16:-16, 16:-16]
    assert np.median(error) <= TOLERANCE_PX.get(name, 0.06)


def test_a_function_and_a_detector_stand_in_the_place_of_a_name(pair):
    np.testing.assert_array_equal(
        optical_flow(*pair, lambda a, b: np.ones((*a.shape, 2))), np.ones((96, 128, 2))
    )
    np.testing.assert_array_equal(
        optical_flow(*pair, PoissonFlow(smoothness=0.5)), optical_flow(*pair, smoothness=0.5)
    )


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"smooth": 1}, r"PF has no setting smooth \(value 1\): choose from .*smoothness$"),
        ({"smoothness": -1}, "PF: smoothness is -1; it should be greater than 0"),
        ({"method": "NDM"}, "NDM measures no velocity: choose from BM, .*PPF, zero$"),
        ({"method": "LK", "name": "x"}, "LK has no setting name"),
        ({"method": "lucas"}, "'lucas' is unknown: choose from BM"),
        ({"method": "DeepFlwo"}, "is unknown: did you mean 'DeepFlow'[?] .*DIS √"),
    ],
)
def test_wrong_settings_are_told_with_name_value_and_remedy(settings, told, pair):
    with pytest.raises(ValueError, match=told) as problem:
        optical_flow(*pair, **settings)
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize(
    ("first", "second", "told"),
    [
        (np.ones((40, 50)), np.ones((40, 51)), r"\(40, 50\) and \(40, 51\): give images"),
        (np.ones((40, 50, 3)), np.ones((40, 50, 3)), r"\(40, 50, 3\): give images \(H, W\)"),
        (np.ones((40, 50)), np.full((40, 50), np.nan), "frame 2 has pixels that are not finite"),
        (np.ones((40, 50)), -np.ones((40, 50)), "negative pixels: PF takes counts"),
        (np.full((40, 50), 0.5), np.ones((40, 50)), "multiply them by the photons"),
        (np.ones((40, 50), "S1"), np.ones((40, 50)), "give numbers"),
    ],
)
def test_what_is_no_pair_of_images_is_refused(first, second, told):
    if "multiply" in told:
        second = 0.5 * second
    with pytest.raises(ValueError, match=told):
        optical_flow(first, second)


def test_a_covariance_comes_with_the_flow_of_methods_that_have_one(pair):
    flow, covariance = optical_flow(*pair, "PF", return_covariance=True)
    np.testing.assert_array_equal(flow, optical_flow(*pair, "PF"))
    assert covariance.shape == (96, 128, 2, 2)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    with pytest.raises(ValueError, match="return_covariance: DIS has none; choose PF or PPF"):
        optical_flow(*pair, "DIS", return_covariance=True)
