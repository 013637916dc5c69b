"""Truth of a rolling shutter over a moving box, against a fixed point that is found here.

The oracle intersects each row's rays with an ideal plane and an ideal box as they are at the row's
time, and asks by bisection, in float64, when the other frame's rows meet the point on its way.
"""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import PerspectiveCamera, Shutter, Trajectory
from megalopta.scenes.material import Material
from megalopta.scenes.motion import Drift, RigidMotion
from megalopta.scenes.scene import Lighting
from megalopta.scenes.spectra.spectrum import flat

from ..conftest import scene_of, square
from .oracle import eyes

CAMERA = PerspectiveCamera(width=64, height=48, fov_deg=70)
FOCAL = 32 / np.tan(np.radians(35))
PATH = Trajectory(
    frames=3,
    position_m=(0.5, -1.0, 2.0),
    look_at_m=(8.0, 2.0, 0.5),
    rotation_deg_s=25.0,
    velocity_m_s=(2.0, -1.0, 0.7),
)
SHUTTER = Shutter(readout_s=0.08)
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
    center, turn = box_at(times)
    start, along = turn.inv().apply(starts - center), turn.inv().apply(ways)
    sides = (np.array([-HALF, HALF])[:, None] - start) / along
    near, far = sides.min(axis=0).max(axis=-1), sides.max(axis=0).min(axis=-1)
    return np.where((near <= far) & (near > 0), near, np.inf)


def image_of(points, times):
    position, axes = eyes(PATH, times)
    seen = np.einsum("nij,nj->ni", axes, points - position)
    return seen[:, :2] / seen[:, 2:] * FOCAL + [CAMERA.width / 2, CAMERA.height / 2]


def row_time(frame, y):
    return 0.1 * frame + 0.08 * ((y - 0.5) / (CAMERA.height - 1) - 0.5)


def place_in(frame, points_at):
    """Image places (n, 2) in a frame of points given by a function of their times."""
    low, high = np.full((2, len(points_at(None))), [[-500.0], [500.0]])
    for _ in range(60):
        y = (low + high) / 2
        times = row_time(frame, y)
        is_below = image_of(points_at(times), times)[:, 1] > y
        low, high = np.where(is_below, y, low), np.where(is_below, high, y)
    times = row_time(frame, low)
    return image_of(points_at(times), times)


@pytest.fixture(scope="module")
def renderer():
    box = trimesh.creation.box(2 * HALF)
    box.apply_translation(CENTER)
    course = Drift(velocity_m_s=tuple(VELOCITY), spin_deg_s=SPIN, spin_axis=tuple(AXIS))
    moving = box, Material(flat(0.0)), RigidMotion(tuple(CENTER), course)
    scene = scene_of(Lighting(flat(1e-9)), square(), moving, origin_m=PATH.origin_m)

    settings = RenderSettings(samples_per_pixel=16, bands_nm=((500, 600),), max_depth=2)
    return SceneRenderer(scene, CAMERA, settings)


@pytest.fixture(scope="module")
def truth(renderer):
    return renderer.shutter_truth(PATH, SHUTTER, 1)


@pytest.fixture(scope="module")
def oracle():
    """Times (n,) of the pixels, and their points on the ground and on the box (n, 3)."""
    x, y = (each.ravel() for each in np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5))
    times = row_time(1, y)
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


def test_flow_is_the_fixed_point_of_row_and_time(truth, oracle):
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
            expected = place_in(other, points_at) - centers[mine]
            assert np.abs(flow.reshape(-1, 2)[mine] - expected).max() < 2e-4
            # As in the same row of the other frame it would be a hundred times that off.
            times_of_row = times[mine] + 0.1 * (other - 1)
            same_row = image_of(points_at(times_of_row), times_of_row) - centers[mine]
            assert np.abs(same_row - expected).max() > 0.02


def test_no_flag_of_occlusion_by_the_box_of_a_row_is_wrong(truth, oracle):
    _, seen, ground, _ = oracle
    mine = (truth.object_id.ravel() == 1) & (seen == 1)
    points = ground[mine]
    for flags, other in ((truth.occluded_forward, 2), (truth.occluded_backward, 0)):
        y = place_in(other, lambda _: points)[:, 1]
        times = row_time(other, np.floor(y) + 0.5)
        position, _ = eyes(PATH, times)
        hidden = to_box(times, position, points - position) < 1
        assert hidden.sum() > 20
        np.testing.assert_array_equal(flags.ravel()[mine], hidden)


@pytest.mark.slow
def test_whole_pixels_agree_with_their_centers_and_with_the_light(renderer, truth):
    found = truth.footprint
    for thing, least in ((1, 1000), (2, 60)):
        pure = (found.purity == 1) & (truth.object_id == thing)
        assert pure.sum() > least
        away = np.linalg.norm(found.forward.mean - truth.flow_forward, axis=-1)[pure]
        assert (away <= 2 * found.forward.spread[pure] + 1e-3).all()
    # The box is black, and all else bright, in light of the same rows.
    image = renderer.exposed(PATH, SHUTTER, 1, seed=3)[..., 0]
    whole = ~found.is_mixed
    assert (image[whole & (truth.object_id == 2)] == 0).all()
    assert image[whole & (truth.object_id != 2)].min() > 1e-10


def test_a_shutter_that_begins_below_sees_what_one_from_above_sees_in_reversed_time():
    scene = scene_of(Lighting(flat(1e-9)), square(), trimesh.creation.box((1, 1, 4)))
    renderer = SceneRenderer(scene, CAMERA, RenderSettings(samples_per_pixel=1))
    below = Shutter(readout_s=0.08, exposure_s=0.01, readout_from="bottom")
    reverse = {"velocity_m_s": (-2.0, 1.0, -0.7), "rotation_deg_s": -25.0}
    backward = PATH.model_copy(update=reverse)
    above = below.model_copy(update={"readout_from": "top"})
    found = renderer.shutter_truth(PATH, below, 0)
    # At the first frame, time 0, every row has the pose of the row in the reversed path.
    expected = renderer.shutter_truth(backward, above, 0)
    assert np.isfinite(found.position).mean() > 0.5
    np.testing.assert_allclose(found.position, expected.position, atol=1e-6)
    usual = renderer.shutter_truth(PATH, above, 0)
    assert np.nanmax(np.abs(usual.position - found.position)) > 0.05
    # Flow ends where the point is at the time of the row there.
    there = CAMERA.pixel_centers() + found.flow_forward
    seen = (found.object_id > 0) & (np.abs(there - CAMERA.pixel_centers()).max(axis=-1) < 20)
    times = 0.1 - 0.08 * ((there[seen][:, 1] - 0.5) / (CAMERA.height - 1) - 0.5)
    again = image_of(found.position[seen], times)
    assert seen.mean() > 0.5
    # The place is found to 1e-4 px, and rows pass at some px each.
    np.testing.assert_allclose(there[seen], again, atol=5e-4)
    # Light differs by noise alone: of instants within the exposure, which are reversed too.
    light, reversed_light = (
        renderer.exposed(path, shutter, 0, seed=3).mean()
        for path, shutter in ((PATH, below), (backward, above))
    )
    assert abs(light / reversed_light - 1) < 0.02
