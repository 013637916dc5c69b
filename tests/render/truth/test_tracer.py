"""Flow, depth and occlusion against geometry worked out here in float64, without the renderer."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from megalopta.render.scene_renderer import SceneRenderer
from megalopta.render.settings import RenderSettings
from megalopta.render.truth.tracer import out_of_view
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.material import Material
from megalopta.scenes.scene import (
    Asset,
    Lighting,
    Placement,
    Scene,
)
from megalopta.scenes.spectra.spectrum import flat
from megalopta.scenes.trajectories.steady import Trajectory

from ..conftest import placed, quad, sphere_cap

CAMERA = PerspectiveCamera(width=96, height=72, fov_deg=70)
SETTINGS = RenderSettings(samples_per_pixel=1, bands_nm=((500, 600),))
BOTH = Trajectory(
    frames=3,
    position_m=(0.5, -1.0, 2.0),
    look_at_m=(8.0, 2.0, 0.0),
    rotation_deg_s=25.0,
    velocity_m_s=(2.0, -1.0, 0.7),
)
TURNING = BOTH.model_copy(update={"velocity_m_s": (0.0, 0.0, 0.0)})
MOVING = BOTH.model_copy(update={"rotation_deg_s": 0.0})


def renderer_of(*meshes):
    names = [f"thing{index}" for index in range(len(meshes))]
    scene = Scene(
        {name: Material(flat(0.5)) for name in names},
        {name: Asset({name: mesh}) for name, mesh in zip(names, meshes, strict=True)},
        tuple(Placement(name, name, np.eye(4)) for name in names),
        Lighting(flat(1e-9)),
    )
    return SceneRenderer(scene, CAMERA, SETTINGS)


def rays(trajectory, frame):
    """Camera position and unit directions, built from the angles, not from the pose matrices."""
    view = np.subtract(trajectory.look_at_m, trajectory.position_m)
    time = frame / trajectory.frame_rate_hz
    turn = Rotation.from_euler("z", trajectory.rotation_deg_s * time, degrees=True)
    forward = turn.apply(view / np.linalg.norm(view))
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    focal = CAMERA.width / 2 / np.tan(np.radians(CAMERA.fov_deg) / 2)
    x = (np.arange(CAMERA.width) + 0.5 - CAMERA.width / 2) / focal
    y = (np.arange(CAMERA.height) + 0.5 - CAMERA.height / 2) / focal
    directions = forward + x[None, :, None] * right + y[:, None, None] * down
    position = np.asarray(trajectory.position_m) + time * np.asarray(trajectory.velocity_m_s)
    return position, directions, (right, down, forward), focal


def analytic_flow(trajectory, frame, other, distance_along):
    """Flow from `frame` to `other` of the surface met at distance_along(origin, directions)."""
    origin, directions, _, _ = rays(trajectory, frame)
    points = origin + distance_along(origin, directions)[..., None] * directions
    position, _, (right, down, forward), focal = rays(trajectory, other)
    offset = points - position
    depth = offset @ forward
    x = focal * (offset @ right) / depth + CAMERA.width / 2
    y = focal * (offset @ down) / depth + CAMERA.height / 2
    columns, rows = np.meshgrid(np.arange(CAMERA.width) + 0.5, np.arange(CAMERA.height) + 0.5)
    return np.stack([x - columns, y - rows], axis=-1)


def plane_distance(origin, directions):
    with np.errstate(divide="ignore"):
        distance = -origin[2] / directions[..., 2]
    return np.where(distance > 0, distance, np.nan)


def sphere_distance(center, radius):
    def along(origin, directions):
        a = (directions**2).sum(-1)
        b = directions @ (origin - center)
        c = ((origin - center) ** 2).sum() - radius**2
        with np.errstate(invalid="ignore"):
            return (-b - np.sqrt(b**2 - a * c)) / a

    return along


@pytest.mark.parametrize("trajectory", [BOTH, TURNING, MOVING], ids=["both", "turn", "move"])
def test_flow_over_a_plane_is_analytic_within_1e_4_px(trajectory, ground):
    truth = renderer_of(ground).truth(trajectory.poses(), 1)
    seen = truth.object_id == 1
    assert seen.mean() > 0.5
    for flow, other in ((truth.flow_forward, 2), (truth.flow_backward, 0)):
        error = flow - analytic_flow(trajectory, 1, other, plane_distance)
        assert np.abs(error[seen]).max() < 1e-4


@pytest.mark.slow
def test_flow_over_a_sphere_is_analytic_within_1e_4_px():
    center, radius = np.array([6.0, 1.2, 0.8]), 2.0
    cap = sphere_cap(center, radius, np.asarray(BOTH.position_m))
    truth = renderer_of(cap).truth(BOTH.poses(), 1)
    seen = truth.object_id == 1
    assert seen.sum() > 300
    for flow, other in ((truth.flow_forward, 2), (truth.flow_backward, 0)):
        error = flow - analytic_flow(BOTH, 1, other, sphere_distance(center, radius))
        assert np.abs(error[seen]).max() < 1e-4


def test_sky_moves_by_rotation_alone():
    truth = renderer_of(quad(np.array([[0, 0, -9], [1, 0, -9], [1, 1, -9], [0, 1, -9.0]])))
    flow = truth.truth(BOTH.poses(), 1).flow_forward
    far = analytic_flow(TURNING, 1, 2, lambda _, directions: np.ones(directions.shape[:2]))
    # The reference turns about a camera that stays; both are exact, float32 storage remains.
    np.testing.assert_allclose(flow, far, atol=1e-5)


def test_turning_left_moves_the_image_right(ground):
    flow = renderer_of(ground).truth(TURNING.poses(), 0).flow_forward
    assert (flow[..., 0] > 0).all()


def test_depth_of_a_plane_is_along_the_optical_axis(ground):
    truth = renderer_of(ground).truth(BOTH.poses(), 0)
    origin, directions, _, _ = rays(BOTH, 0)  # directions have unit depth
    expected = plane_distance(origin, directions)
    seen = truth.object_id == 1
    np.testing.assert_allclose(truth.depth[seen], expected[seen], rtol=1e-5)
    assert np.isinf(truth.depth[~seen]).all()


def test_normals_are_geometric_and_face_the_camera():
    box = trimesh.creation.box((1, 1, 1))
    box.invert()  # normals inward: the truth must turn them round
    box.apply_translation([6, 1, 1])
    truth = renderer_of(box).truth(BOTH.poses(), 0)
    seen = truth.object_id == 1
    _, directions, _, _ = rays(BOTH, 0)
    normals = truth.normal[seen]
    assert ((normals * directions[seen]).sum(-1) < 0).all()
    assert set(map(tuple, np.abs(normals).round(6))) <= {(1, 0, 0), (0, 1, 0), (0, 0, 1)}
    assert np.isnan(truth.normal[~seen]).all()


def cubic_sample(image, x, y):
    """Cubic Lagrange interpolation at pixel indices x, y, from the 4 × 4 pixels around."""

    def weights(t):
        nodes = np.array([-1, 0, 1, 2])
        return [
            np.prod([(t - other) / (node - other) for other in nodes if other != node], axis=0)
            for node in nodes
        ]

    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    return sum(
        wy[..., None] * wx[..., None] * image[row + i - 1, column + j - 1]
        for i, wy in enumerate(weights(y - row))
        for j, wx in enumerate(weights(x - column))
    )


def test_forward_and_backward_flow_agree_where_both_see_the_point(ground):
    center = np.array([6.0, 1.2, 0.8])
    renderer = renderer_of(ground, sphere_cap(center, 1.0, np.asarray(BOTH.position_m)))
    poses = BOTH.poses()
    first, second = renderer.truth(poses, 0), renderer.truth(poses, 1)
    x = np.arange(CAMERA.width) + first.flow_forward[..., 0]
    y = np.arange(CAMERA.height)[:, None] + first.flow_forward[..., 1]
    seen = (first.object_id > 0) & ~first.occluded_forward
    check = seen & (x > 2) & (x < CAMERA.width - 3) & (y > 2) & (y < CAMERA.height - 3)
    x, y = x[check], y[check]
    # Between different things, or toward the horizon, an interpolated flow means nothing.
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    around = [(row + i, column + j) for i in (-1, 0, 1, 2) for j in (-1, 0, 1, 2)]
    ids = first.object_id[check]
    smooth = np.all([second.object_id[place] == ids for place in around], axis=0)
    smooth &= np.max([second.depth[place] for place in around], axis=0) < 60
    assert smooth.sum() > 2500
    residual = first.flow_forward[check] + cubic_sample(second.flow_backward, x, y)
    assert np.linalg.norm(residual[smooth], axis=-1).max() < 1e-3


def test_occlusion_is_exact_behind_a_rectangle():
    # A wall x = 10 behind a rectangle x = 5; the camera slides sideways along +y.
    slide = Trajectory(
        frames=2,
        frame_rate_hz=1,
        position_m=(0, 0, 0),
        look_at_m=(1, 0, 0),
        velocity_m_s=(0.0, 0.83, 0.11),
    )
    wall = quad(np.array([[10, -99, -99], [10, 99, -99], [10, 99, 99], [10, -99, 99.0]]))
    low, high = np.array([-1.013, -0.721]), np.array([1.117, 0.857])
    rectangle = quad(
        np.array([[5, low[0], low[1]], [5, high[0], low[1]], [5, *high], [5, low[0], high[1]]])
    )
    truth = renderer_of(wall, rectangle).truth(slide.poses(), 0)
    origin, directions, _, _ = rays(slide, 0)
    on_wall = truth.object_id == 1
    points = origin + 10 * directions / directions[..., :1]
    other = origin + np.asarray(slide.velocity_m_s)
    crossing = other + (points - other) * ((5 - other[0]) / (points - other)[..., :1])
    hidden = ((crossing[..., 1:] > low) & (crossing[..., 1:] < high)).all(axis=-1)
    assert (hidden & on_wall).sum() > 100
    assert (truth.occluded_forward[on_wall] == hidden[on_wall]).all()
    assert not truth.occluded_forward[~on_wall].any()


def test_points_behind_the_other_camera_have_no_flow(ground):
    leap = Trajectory(
        frames=2,
        frame_rate_hz=1,
        position_m=(0, 0, 2),
        look_at_m=(5, 0, 0),
        velocity_m_s=(8.0, 0, 0),
    )
    truth = renderer_of(ground).truth(leap.poses(), 0)
    assert np.isnan(truth.flow_forward[-1]).all()
    assert out_of_view(truth.flow_forward)[-1].all()


def test_first_and_last_frame_have_no_flow_beyond_the_sequence(ground):
    renderer, poses = renderer_of(ground), BOTH.poses()
    assert np.isnan(renderer.truth(poses, 0).flow_backward).all()
    assert np.isnan(renderer.truth(poses, 2).flow_forward).all()


def test_object_ids_count_placements_from_one(ground):
    box = trimesh.creation.box((1, 1, 1))
    materials, assets, _ = placed(box)
    shifts = [np.eye(4), np.eye(4)]
    shifts[0][:3, 3], shifts[1][:3, 3] = (6, 3.5, 1), (6, 0.5, 1)
    scene = Scene(
        materials,
        assets,
        tuple(Placement("thing", "box", pose) for pose in shifts),
        Lighting(flat(1.0)),
    )
    ids = SceneRenderer(scene, CAMERA, SETTINGS).truth(BOTH.poses(), 0).object_id
    left, right = ((ids == number).nonzero()[1].mean() for number in (1, 2))
    assert left < right  # +y is to the left of a camera that looks along +x
