"""Truth of moving and bending objects, and far from the world's origin, against closed forms.

The oracle intersects rays with ideal planes, spheres and boxes in float64 and carries the points
with rotations of its own; no meshes, no renderer.
"""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from megalopta.scenes import PerspectiveCamera
from megalopta.scenes.forest.sway import Sway
from megalopta.scenes.motion import Drift, RigidMotion

from ..conftest import GRAY, renderer_of, sphere_cap, square
from .oracle import BOTH, Pinhole, box_hit, eye, plane_hit, sphere_hit

CAMERA = PerspectiveCamera(width=120, height=90, fov_deg=70)
FAR = np.array([1000.0, -400.0, 30.0])
TIMES = np.array([0.0, 0.1, 0.2])


def path_at(offset):
    places = {"position_m": BOTH.position_m, "look_at_m": (8.0, 2.0, 0.5)}
    moved = {name: tuple(np.add(place, offset)) for name, place in places.items()}
    return BOTH.model_copy(update=moved)


def renderer_on(path, *things):
    """Things are (mesh, motion)."""
    gray = ((mesh, GRAY, motion) for mesh, motion in things)
    return renderer_of(CAMERA, *gray, more={"origin_m": path.origin_m})


def at(position, distance, directions):
    """Points along rays; anything where the distance is infinite."""
    return position + np.where(np.isfinite(distance), distance, 1.0)[..., None] * directions


def ground_hit(position, directions, height=0.0):
    distance = plane_hit(position, directions, height)
    # The square ends 500 m away; no other surface comes near.
    return np.where(distance < 480, distance, np.inf)


HALF = np.array([0.6, 0.4, 0.8])
SPIN = {"spin_deg_s": 90.0, "spin_axis": (1.0, 2.0, -0.5)}
VELOCITY = np.array([-1.5, 2.0, 0.8])
AXIS = np.array(SPIN["spin_axis"]) / np.linalg.norm(SPIN["spin_axis"])


def spin_at(time):
    return Rotation.from_rotvec(np.radians(90.0) * time * AXIS)


def moving_box(center, velocity):
    box = trimesh.creation.box(2 * HALF).apply_translation(center)
    return box, RigidMotion(tuple(center), Drift(velocity_m_s=tuple(velocity), **SPIN))


@pytest.mark.slow
@pytest.mark.parametrize("offset", [np.zeros(3), FAR], ids=["near", "1 km away"])
def test_plane_sphere_and_moving_box_are_analytic_within_1e_4_px(offset):
    path, oracle = path_at(offset), Pinhole(CAMERA, path_at(offset))
    ground = square(half_width=500).apply_translation(offset)
    ball, box_center = np.array([7.0, 3.6, 1.0]) + offset, np.array([5.5, 0.6, 1.2]) + offset
    cap = sphere_cap(ball, 1.0, oracle.rays(1)[0])
    moving = moving_box(box_center, VELOCITY)
    renderer = renderer_on(path, (ground, None), (cap, None), moving)
    truth = renderer.truth(path.poses(), 1, TIMES)

    position, directions = oracle.rays(1)
    center = box_center + VELOCITY * TIMES[1]
    distances = np.stack(
        [
            ground_hit(position, directions, offset[2]),
            np.nan_to_num(sphere_hit(ball, 1.0)(position, directions), nan=np.inf),
            box_hit(HALF, center, spin_at(TIMES[1]), position, directions),
        ]
    )
    seen = np.where(np.isfinite(distances).any(axis=0), distances.argmin(axis=0) + 1, 0)
    # Outlines of the cap's facets, and the ground beyond 480 m, may differ.
    assert (truth.object_id == seen).mean() > 0.98
    for flow, other in ((truth.flow_forward, 2), (truth.flow_backward, 0)):
        for thing, least in ((1, 3000), (2, 150), (3, 300)):
            where = (truth.object_id == thing) & (seen == thing)
            assert where.sum() > least
            points = at(position, distances[thing - 1], directions)
            if thing == 3:
                step = spin_at(TIMES[other] - TIMES[1])
                turned = step.apply((points - center).reshape(-1, 3)).reshape(points.shape)
                points = turned + box_center + VELOCITY * TIMES[other]
            error = flow - oracle.displacement(other, points)
            assert np.abs(error[where]).max() < 1e-4
    boxed = truth.object_id == 3
    exact = at(position, distances[2], directions)
    np.testing.assert_allclose(truth.position[boxed], exact[boxed], atol=2e-6)


@pytest.mark.parametrize("offset", [np.zeros(3), FAR], ids=["near", "1 km away"])
def test_no_flag_of_occlusion_by_a_moving_box_is_wrong(offset):
    path, oracle = path_at(offset), Pinhole(CAMERA, path_at(offset))
    ground = square(half_width=500).apply_translation(offset)
    center = np.array([5.5, 0.6, 1.2]) + offset
    moving = moving_box(center, 3 * VELOCITY)
    truth = renderer_on(path, (ground, None), moving).truth(path.poses(), 1, TIMES)
    position, directions = oracle.rays(1)
    points = at(position, ground_hit(position, directions, offset[2]), directions)
    for flags, other in ((truth.occluded_forward, 2), (truth.occluded_backward, 0)):
        seat, _ = eye(path, other)
        then = center + 3 * VELOCITY * TIMES[other]
        hit = box_hit(HALF, then, spin_at(TIMES[other]), seat, points - seat)
        on_ground = truth.object_id == 1
        assert (hit < 1)[on_ground].sum() > 100
        assert ((hit < 1) == flags)[on_ground].all()


def swaying_pole():
    """A rough pole of small triangles, as tall as a young tree."""
    pole = trimesh.creation.cylinder(0.25, 6.0, sections=24)
    pole.apply_translation([6, 0, 3])
    pole = pole.subdivide_to_size(0.2)
    sway = Sway((6.0, 0.0, 0.0), 6.0, (0.6, 0.8), 0.4, 0.8, (0.3, 2.0))
    return pole, sway


def test_flow_of_a_swaying_tree_is_that_of_its_bending():
    path = path_at(np.zeros(3))
    pole, sway = swaying_pole()
    truth = renderer_on(path, (pole, sway)).truth(path.poses(), 1, TIMES)
    seen = truth.object_id == 1
    assert seen.sum() > 200

    def top(time):
        angle = 2 * np.pi * 0.8 * time
        along, across = 0.4 * np.sin(angle + 0.3), 0.16 * np.sin(1.13 * angle + 2.0)
        return np.array([0.6 * along - 0.8 * across, 0.8 * along + 0.6 * across])

    points = truth.position[seen]
    bend = (points[:, 2:] / 6) ** 2
    oracle = Pinhole(CAMERA, path)
    for flow, other in ((truth.flow_forward, 2), (truth.flow_backward, 0)):
        then = truth.position.copy()
        then[seen, :2] += bend * (top(TIMES[other]) - top(TIMES[1]))
        error = (flow - oracle.displacement(other, then))[seen]
        # Between its vertices, 0.2 m apart at most, a bent edge is straight: off by up to
        # (0.2/6)²/4 · 0.4 m of sway, 1e-4 m, which is 2e-3 px at 5 m.
        assert np.linalg.norm(error, axis=-1).max() < 4e-3
        assert np.linalg.norm(flow[seen], axis=-1).min() > 0.5


STEADY = RigidMotion((1.0, 2.0, 3.0), Drift(velocity_m_s=(1, 2, 3), **SPIN))


@pytest.mark.parametrize("motion", [swaying_pole()[1], STEADY], ids=["sway", "steady"])
def test_a_motion_can_be_undone_and_points_can_have_times_of_their_own(motion):
    points = np.random.default_rng(1).uniform(0, 5, (20, 3))
    np.testing.assert_allclose(motion.undo(motion.carry(points, 0.7), 0.7), points, atol=1e-12)
    times = np.linspace(-0.2, 1.3, 20)
    alone = [motion.carry(point[None], time)[0] for point, time in zip(points, times, strict=True)]
    np.testing.assert_allclose(motion.carry(points, times), alone, atol=1e-12)
