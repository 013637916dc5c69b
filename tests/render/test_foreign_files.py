"""Truth in files that nobody here made, against an independent ray caster; skipped without files.

MEGALOPTA_FOREIGN_FILES names a folder of files, such as the `models` of trimesh's repository or
scenes of mitsuba-data. Those in the packages meshcat and pyvista serve too, where they are
installed. The ray caster is Möller and Trumbore's in float64, over all triangles.
"""

import os
import re
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer, mi
from megalopta.scenes import Light, Meshes, PerspectiveCamera, Trajectory
from megalopta.scenes.meshes.mesh_file import SUFFIXES

from .truth.oracle import triangle_hit

CAMERA = PerspectiveCamera(width=24, height=18, fov_deg=50)
LARGEST = 5_000_000
Y_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])


def folders():
    if given := os.environ.get("MEGALOPTA_FOREIGN_FILES"):
        yield Path(given)
    for name in ("meshcat", "pyvista"):
        if (found := find_spec(name)) and found.origin:
            yield Path(found.origin).parent


FILES = sorted(
    path
    for folder in folders()
    for path in folder.rglob("*")
    if path.suffix.lower() in SUFFIXES and path.stat().st_size < LARGEST
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FILES, reason="needs MEGALOPTA_FOREIGN_FILES"),
    pytest.mark.parametrize(
        "path", FILES, ids=[f"{path.parent.name}/{path.name}" for path in FILES]
    ),
]


def path_of(points):
    """Path of a camera that looks at points (n, 3) from outside, moves and turns."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, extent = (low + high) / 2, (high - low).max()
    return Trajectory(
        frames=2,
        frame_rate_hz=5,
        position_m=tuple(middle + extent * np.array([-1.1, -0.8, 0.6])),
        look_at_m=tuple(middle),
        velocity_m_s=tuple(extent * np.array([0.3, 0.2, -0.2])),
        rotation_deg_s=10,
    )


def opened(path):
    """Scene of a file, animated if it is, and its scale; skips a file that is refused."""
    given = {"file": path, "animate": path.suffix.lower() in (".glb", ".gltf")}
    start = Trajectory(frames=1, position_m=(-1, 0, 0), look_at_m=(0, 0, 0))
    for _ in range(3):
        try:
            scene = Meshes(files=[given]).build(Light(), CAMERA, start)
        except ValueError as problem:
            message = str(problem)
            assert len(message) < 600
            if scale := re.search(r"such as `scale: (\S+)`", message):
                given["scale"] = float(scale[1])
            elif "omit animate" in message:
                given["animate"] = False
            else:
                pytest.skip(f"refused: {message}")
        else:
            return scene, given.get("scale", 1.0)
    raise AssertionError(f"{path}: refused again after what was advised")


def triangles_of(scene, time_s):
    """Triangles (T, 3, 3) of the objects at a time, and which moves (T,)."""
    found, moving = [], []
    for placement in scene.placements:
        for mesh in scene.assets[placement.asset].parts.values():
            points = mesh.vertices @ placement.to_world[:3, :3].T + placement.to_world[:3, 3]
            if placement.motion:
                points = placement.motion.carry(points, time_s)
            found.append(points[mesh.faces])
            moving.append(np.full(len(mesh.faces), placement.motion is not None))
    return np.concatenate(found), np.concatenate(moving)


def test_flow_and_depth_agree_with_a_ray_caster(path):
    scene, _ = opened(path)
    before, _ = triangles_of(scene, 0.0)
    course = path_of(before.reshape(-1, 3))
    poses, times = course.poses(), course.times_s
    after, _ = triangles_of(scene, float(times[1]))
    renderer = SceneRenderer(scene, CAMERA, RenderSettings(samples_per_pixel=1))
    truth = renderer.truth(poses, 0, times)
    axes = CAMERA.directions().reshape(-1, 3)
    distance, best, weights = triangle_hit(poses[0, :3, 3], axes @ poses[0, :3, :3].T, before)
    hit, depth = np.isfinite(distance), truth.depth.ravel()
    # Where a ray passes within rounding of an edge, either side may be hit.
    same = np.isclose(distance * axes[:, 2], depth, rtol=1e-5)
    assert (same | (hit != np.isfinite(depth))).mean() > 0.98
    assert (same & hit).sum() > 20
    corners, (first, second) = after[best], weights.T[..., None]
    points = (1 - first - second) * corners[:, 0] + first * corners[:, 1] + second * corners[:, 2]
    place = CAMERA.project((points - poses[1, :3, 3]) @ poses[1, :3, :3])
    flow = truth.flow_forward.reshape(-1, 2) + CAMERA.pixel_centers().reshape(-1, 2)
    assert np.abs(flow - place)[same & hit].max() < 1e-4
    ways = points - poses[1, :3, 3]
    nearest = triangle_hit(poses[1, :3, 3], np.where(hit[:, None], ways, 1.0), after)[0]
    normals = [
        np.cross(each[:, 1] - each[:, 0], each[:, 2] - each[:, 0]) for each in (before, after)
    ]
    sides = [np.einsum("ij,ij->i", normals[0][best], axes @ poses[0, :3, :3].T)]
    sides.append(np.einsum("ij,ij->i", normals[1][best], ways))
    hidden = (nearest < 1 - 1e-5) | (sides[0] * sides[1] <= 0)
    assert (hidden == truth.occluded_forward.ravel())[same & hit].mean() > 0.98


def test_triangles_are_where_another_reader_finds_them(path):
    scene, scale = opened(path)
    found, _ = triangles_of(scene, 0.0)
    if path.suffix == ".xml":
        nearest_of_mitsuba(path, found)
        return
    read = trimesh.load_scene(path, process=False).to_mesh()
    expected = read.triangles * scale
    if path.suffix.lower() in (".glb", ".gltf", ".obj"):
        expected = expected @ Y_UP.T

    def area(triangles):
        a, b, c = triangles.swapaxes(0, 1)
        return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2

    assert area(found) == pytest.approx(area(expected), rel=1e-5)
    for end in (np.min, np.max):
        ends = [end(each.reshape(-1, 3), axis=0) for each in (found, expected)]
        np.testing.assert_allclose(*ends, atol=1e-5 * np.ptp(expected))


def nearest_of_mitsuba(path, triangles):
    course = path_of(triangles.reshape(-1, 3))
    pose, scene = course.poses()[0], mi.load_file(str(path))
    ways = CAMERA.directions().reshape(-1, 3) @ pose[:3, :3].T
    start = np.broadcast_to(pose[:3, 3] @ Y_UP, ways.shape)
    rays = mi.Ray3f(*(mi.Point3f(*each.T.tolist()) for each in (start, ways @ Y_UP)))
    expected = np.array(scene.ray_intersect_preliminary(rays, coherent=False).t)
    # Round shapes have facets here, up to 1.1e-3 of their radius below them.
    close = np.isclose(triangle_hit(pose[:3, 3], ways, triangles)[0], expected, rtol=3e-3)
    assert close.mean() > 0.97
