"""Truth of a rolling shutter over a moving box, against a fixed point that is found here.

The oracle intersects each line's rays with an ideal plane and an ideal box as they are at the
line's time, and asks by bisection, in float64, when the other frame's lines meet the point on its
way. Lines are rows or columns.
"""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from megalopta.scenes import PerspectiveCamera, Shutter
from megalopta.scenes.material import Material
from megalopta.scenes.motion import Drift, RigidMotion
from megalopta.scenes.spectra.spectrum import flat

from ..conftest import renderer_of, square
from .oracle import BOTH, box_hit, eyes

CAMERA = PerspectiveCamera(width=64, height=48, fov_deg=70)
FOCAL = 32 / np.tan(np.radians(35))
PATH = BOTH.model_copy(update={"look_at_m": (8.0, 2.0, 0.5)})
ACROSS = {"top": 1, "left": 0}
CENTER, HALF = np.array([5.5, 0.6, 1.2]), np.array([0.6, 0.4, 0.8])
VELOCITY, AXIS, SPIN = np.array([-1.5, 2.0, 0.8]), np.array([1.0, 2.0, -0.5]), 90.0


def box_at(times):
    """Center (n, 3) and orientation of the box."""
    angle = np.radians(SPIN) * times[:, None]
    return CENTER + times[:, None] * VELOCITY, Rotation.from_rotvec(
        angle * AXIS / np.linalg.norm(AXIS)
    )


def to_box(times, starts, ways):
    """Where ways (n, 3) first meet the box as it is at their times, in units of them."""
    return box_hit(HALF, *box_at(times), starts, ways)


def image_of(points, times):
    position, axes = eyes(PATH, times)
    seen = np.einsum("nij,nj->ni", axes, points - position)
    return seen[:, :2] / seen[:, 2:] * FOCAL + [CAMERA.width / 2, CAMERA.height / 2]


def line_time(frame, place, side):
    last = CAMERA.shape[1 - ACROSS[side]] - 1
    return 0.1 * frame + 0.08 * ((place - 0.5) / last - 0.5)


def place_in(frame, points_at, side):
    """Image places (n, 2) in a frame of points given by a function of their times."""
    low, high = np.full((2, len(points_at(None))), [[-500.0], [500.0]])
    for _ in range(60):
        place = (low + high) / 2
        times = line_time(frame, place, side)
        is_beyond = image_of(points_at(times), times)[:, ACROSS[side]] > place
        low, high = np.where(is_beyond, place, low), np.where(is_beyond, high, place)
    times = line_time(frame, low, side)
    return image_of(points_at(times), times)


@pytest.fixture(scope="module")
def renderer():
    box = trimesh.creation.box(2 * HALF)
    box.apply_translation(CENTER)
    course = Drift(velocity_m_s=tuple(VELOCITY), spin_deg_s=SPIN, spin_axis=tuple(AXIS))
    moving = box, Material(flat(0.0)), RigidMotion(tuple(CENTER), course)
    given = {"samples_per_pixel": 16, "max_depth": 2, "more": {"origin_m": PATH.origin_m}}
    return renderer_of(CAMERA, square(), moving, **given)


@pytest.fixture(scope="module", params=ACROSS)
def side(request):
    """Side of the line that is read first."""
    return request.param


@pytest.fixture(scope="module")
def truth(renderer, side):
    return renderer.shutter_truth(PATH, Shutter(readout_s=0.08, readout_from=side), 1)


@pytest.fixture(scope="module")
def oracle(side):
    """Times (n,) of the pixels, and their points on the ground and on the box (n, 3)."""
    x, y = (each.ravel() for each in np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5))
    times = line_time(1, (x, y)[ACROSS[side]], side)
    position, axes = eyes(PATH, times)
    camera_ways = np.stack([x - 32, y - 24, np.full(x.size, FOCAL)], axis=1)
    ways = np.einsum("nji,nj->ni", axes, camera_ways)
    ground = -position[:, 2] / ways[:, 2]
    ground[(ground < 0) | (ground * np.linalg.norm(ways, axis=1) > 400)] = np.inf
    box = to_box(times, position, ways)
    distances = np.stack([ground, box])
    points = position + np.where(np.isfinite(distances), distances, 1)[..., None] * ways
    seen = np.where(np.isfinite(distances).any(axis=0), distances.argmin(axis=0) + 1, 0)
    return times, seen, *points


def on_box(points, times):
    """What points (n, 3) of the box at times (n,) are at others; at None, as many of anything."""
    center, turn = box_at(times)
    placed = turn.inv().apply(points - center)

    def at(others):
        if others is None:
            return points
        center, turn = box_at(others)
        return center + turn.apply(placed)

    return at


def test_flow_is_the_fixed_point_of_line_and_time(truth, oracle, side):
    times, seen, ground, box = oracle
    objects = truth.object_id.ravel()
    # The ground's far end is not where the oracle ends it.
    assert (objects == seen).mean() > 0.97
    centers = CAMERA.pixel_centers().reshape(-1, 2)
    for flow, other in ((truth.flow_forward, 2), (truth.flow_backward, 0)):
        for thing, points, least in ((1, ground, 1000), (2, box, 100)):
            mine = (objects == thing) & (seen == thing)
            assert mine.sum() > least
            points_at = (
                on_box(points[mine], times[mine])
                if thing == 2
                else lambda _, points=points[mine]: points
            )
            expected = place_in(other, points_at, side) - centers[mine]
            assert np.abs(flow.reshape(-1, 2)[mine] - expected).max() < 2e-4
            # As in the same line of the other frame it would be a hundred times that off.
            times_of_line = times[mine] + 0.1 * (other - 1)
            same_line = image_of(points_at(times_of_line), times_of_line) - centers[mine]
            assert np.abs(same_line - expected).max() > 0.02


def test_no_flag_of_occlusion_by_the_box_of_a_line_is_wrong(truth, oracle, side):
    _, seen, ground, _ = oracle
    mine = (truth.object_id.ravel() == 1) & (seen == 1)
    points = ground[mine]
    for flags, other in ((truth.occluded_forward, 2), (truth.occluded_backward, 0)):
        place = place_in(other, lambda _: points, side)[:, ACROSS[side]]
        times = line_time(other, np.floor(place) + 0.5, side)
        position, _ = eyes(PATH, times)
        hidden = to_box(times, position, points - position) < 1
        assert hidden.sum() > 20
        np.testing.assert_array_equal(flags.ravel()[mine], hidden)


@pytest.mark.slow
def test_whole_pixels_agree_with_their_centers_and_with_the_light(renderer, truth, side):
    found = truth.footprint
    for thing, least in ((1, 1000), (2, 60)):
        pure = (found.purity == 1) & (truth.object_id == thing)
        assert pure.sum() > least
        away = np.linalg.norm(found.forward.mean - truth.flow_forward, axis=-1)[pure]
        assert (away <= 2 * found.forward.spread[pure] + 1e-3).all()
    # The box is black, and all else bright, in light of the same lines.
    shutter = Shutter(readout_s=0.08, readout_from=side)
    image = renderer.exposed(PATH, shutter, 1, seed=3)[..., 0]
    whole = ~found.is_mixed
    assert (image[whole & (truth.object_id == 2)] == 0).all()
    assert image[whole & (truth.object_id != 2)].min() > 1e-10
