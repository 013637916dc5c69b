"""Textures of colors and own scenes: light against closed forms, truth against a ray caster."""

import math
from functools import partial

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import Light, Meshes, PerspectiveCamera, Trajectory, build_scene
from megalopta.scenes.material import ColorTexture, Material
from megalopta.scenes.scene import Lighting, Sun
from megalopta.scenes.spectra.color import BLUE, GREEN, RED, reflectance_of_color
from megalopta.scenes.spectra.spectrum import Spectrum, flat

from ..scenes.meshes import test_figures as figures
from ..scenes.meshes.files import Gltf
from .conftest import band_means, down, scene_of, square, vectorized
from .truth.oracle import Pinhole, triangle_hit

BANDS = ((400.0, 480.0), (480.0, 560.0), (560.0, 640.0), (640.0, 720.0), (720.0, 800.0))
LIGHT = Spectrum((400.0, 800.0), (1e-9, 3e-9))
DOWN = down(9)
KINDS = [
    ("path", "scalar"),
    pytest.param("path", "auto", marks=vectorized),
    pytest.param("baked", "auto", marks=[vectorized, pytest.mark.slow]),
]


def painted(weight):
    """A wide level square with a texture of colors."""
    mesh = square(half_width=1e4)
    mesh.visual = trimesh.visual.TextureVisuals(uv=np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]))
    return mesh, Material(flat(0.0), ColorTexture(weight, (RED, GREEN, BLUE)))


def mean_radiance(scene, integrator, backend, samples, depth):
    settings = RenderSettings(
        integrator=integrator, backend=backend, bands_nm=BANDS, samples_per_pixel=samples,
        max_depth=depth,
    )  # fmt: skip
    camera = PerspectiveCamera(width=16, height=16, fov_deg=20)
    renderer = SceneRenderer(scene, camera, settings, DOWN)
    assert renderer.integrator.startswith(integrator)
    return renderer.radiance(DOWN[0], 1).mean(axis=(0, 1), dtype=np.float64)


COLOR = (0.7, 0.2, 0.4)


@pytest.mark.parametrize(("integrator", "backend"), KINDS)
@pytest.mark.parametrize("lit_by", ["sun", "sky"])
def test_a_texture_of_colors_reflects_as_their_reflectance(integrator, backend, lit_by):
    sun = Lighting(flat(0.0), Sun((math.sin(1.0), 0.0, math.cos(1.0)), LIGHT))
    lighting = sun if lit_by == "sun" else Lighting(LIGHT)
    scene = scene_of(lighting, painted(np.tile(np.float32(COLOR), (4, 4, 1))))
    expected = band_means(BANDS, reflectance_of_color(COLOR), LIGHT)
    expected *= math.cos(1.0) / math.pi if lit_by == "sun" else 1
    # Composed surfaces choose one of six by chance: of 16 000 paths, their mean scatters by 1 %.
    is_known = backend == "auto" and lit_by == "sun"
    found = mean_radiance(scene, integrator, backend, 64, 2)
    np.testing.assert_allclose(found, expected, rtol=6e-3 if is_known else 0.06)


@pytest.mark.parametrize(("integrator", "backend"), KINDS)
def test_light_between_colored_surfaces_is_that_of_their_reflectance(integrator, backend):
    """The inside of half a sphere, open above."""
    room = trimesh.creation.icosphere(4, 20.0)
    room.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(room.vertices), 2)))
    color = Material(
        flat(0.0), ColorTexture(np.full((2, 2, 3), COLOR, np.float32), (RED, GREEN, BLUE))
    )
    keep = room.triangles_center[:, 2] < 0
    bowl = trimesh.Trimesh(room.vertices, room.faces[keep], process=False)
    bowl.visual = room.visual
    scene = scene_of(Lighting(LIGHT), (bowl, color))
    # From any point of a half sphere, half of the light comes from the opening and half from the
    # wall, evenly: L = ρ·(sky + L)/2.
    grid = [np.linspace(*band, 4001) for band in BANDS]
    rho = [reflectance_of_color(COLOR)(each) for each in grid]
    expected = [
        np.mean(share * LIGHT(each) / (2 - share)) for share, each in zip(rho, grid, strict=True)
    ]
    samples = 256 if backend == "scalar" else 1024
    found = mean_radiance(scene, integrator, backend, samples, 12)
    np.testing.assert_allclose(found, expected, rtol=0.05)


VIEW = Trajectory(
    frames=3,
    position_m=(-6.0, 1.0, 2.5),
    look_at_m=(0.0, 0.0, 0.5),
    rotation_deg_s=20.0,
    velocity_m_s=(2.0, -3.0, 0.5),
)
CAMERA = PerspectiveCamera(width=48, height=36, fov_deg=60)
PINHOLE = Pinhole(CAMERA, VIEW)


def truth_of(scene):
    settings = RenderSettings(samples_per_pixel=1, bands_nm=((500, 600),))
    return SceneRenderer(scene, CAMERA, settings).truth(VIEW.poses(), 1, VIEW.times_s)


def cast(triangles):
    """What rays of the second frame meet: distances (H, W), triangles, and weights."""
    position, directions = PINHOLE.rays(1)
    distance, which, weights = triangle_hit(position, directions.reshape(-1, 3), triangles)
    distance, which = (each.reshape(CAMERA.height, CAMERA.width) for each in (distance, which))
    return distance, which, weights.reshape(*which.shape, 2)


def assert_truth_is_of(triangles_at, truth, is_seen, least):
    """Outline, depth and flow of an object are those of triangles at their times (s)."""
    distance, which, weights = cast(triangles_at(VIEW.times_s[1]))
    seen = which >= 0
    assert seen.sum() > least
    np.testing.assert_array_equal(is_seen, seen)
    np.testing.assert_allclose(truth.depth[seen], distance[seen], rtol=2e-6)
    for flow, other in ((truth.flow_forward, 2), (truth.flow_backward, 0)):
        a, b, c = np.moveaxis(triangles_at(VIEW.times_s[other])[which], -2, 0)
        same_place = a + weights[..., :1] * (b - a) + weights[..., 1:] * (c - a)
        error = flow - PINHOLE.displacement(other, same_place)
        assert np.abs(error[seen]).max() < 1e-4


PLACE = np.array([-2.0, 0.2, 1.0])
KEYS_S = np.array([0.0, 0.05, 0.3], np.float32)
ANGLES_DEG = np.array([0.0, 20.0, 160.0])
SLIDES = np.array([[0, 0, 0], [0, 0.5, 0], [1, 0.5, 0]], np.float32)


def mill_at(triangles, time_s):
    """Triangles of a wheel's blade at a time, z up: the wheel turns, the blade slides along it."""
    slide = np.array([np.interp(time_s, KEYS_S, each) for each in SLIDES.T])
    angle = np.interp(time_s, KEYS_S, ANGLES_DEG)
    wheel = Rotation.from_euler("x", angle, degrees=True).as_matrix()
    x, y, z = np.moveaxis((triangles + slide) @ wheel.T * [1, 1, 2] + [0, 1.2, 0], -1, 0)
    return np.stack([x, -z, y], axis=-1) + PLACE


def written_mill(path):
    """Write the wheel as an animated file, and return the blade's triangles in its own axes."""
    file, blade = Gltf(), trimesh.creation.icosphere(2, 1.0)
    vertices = (blade.vertices * [0.3, 1.0, 0.5]).astype(np.float32)
    file.triangle(vertices, faces=blade.faces)
    turns = Rotation.from_euler("x", ANGLES_DEG[:, None], degrees=True).as_quat()
    file.animate(KEYS_S, (1, "rotation", turns), (2, "translation", SLIDES))
    file.header["nodes"] = [
        {"name": "mast", "children": [1], "scale": [1, 1, 2], "translation": [0, 1.2, 0]},
        {"name": "wheel", "children": [2]},
        {"name": "blade", "mesh": 0},
        {"name": "still", "mesh": 0, "translation": [3, 0, -3]},
    ]
    path.write_bytes(file.glb())
    return vertices[blade.faces].astype(np.float64)


@pytest.mark.parametrize("is_packed", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_truth_of_a_skinned_and_morphed_figure_is_that_of_an_independent_ray_caster(
    tmp_path, is_packed
):
    file = figures.arm(has_shapes=not is_packed)
    (part,) = file.header["meshes"][0]["primitives"]
    if is_packed:
        colors = np.random.default_rng(1).random((len(figures.BENT), 3)).astype(np.float32)
        part["attributes"]["COLOR_0"] = file.accessor(colors)
        for accessor in part["attributes"].values():
            file.with_meshopt(accessor, "ATTRIBUTES")
        file.with_meshopt(part["indices"], "TRIANGLES")
    (tmp_path / "arm.glb").write_bytes(file.glb())
    given = {"file": str(tmp_path / "arm.glb"), "animate": True, "position_m": (-2, 0.2, 0)}
    scene = build_scene(Meshes(files=given), Light(), CAMERA, VIEW)
    truth = truth_of(scene)

    def triangles_at(time_s):
        vertices = figures.bent(time_s, has_shapes=not is_packed)
        x, y, z = np.moveaxis(vertices[figures.TUBE.faces], -1, 0)
        return np.stack([x - 2, 0.2 - z, y], axis=-1)

    seen = truth.object_id > 0
    assert_truth_is_of(triangles_at, truth, seen, 60)
    assert np.linalg.norm(truth.flow_forward[seen], axis=-1).max() > 1


def test_truth_of_an_animated_file_is_that_of_an_independent_ray_caster(tmp_path):
    blade = written_mill(tmp_path / "mill.glb")
    given = {"file": str(tmp_path / "mill.glb"), "animate": True, "position_m": tuple(PLACE)}
    scene = build_scene(Meshes(files=given), Light(), CAMERA, VIEW)
    assert scene.is_moving
    truth = truth_of(scene)
    is_blade = np.array(["", *scene.kinds])[truth.kind_id] == "blade"
    assert_truth_is_of(partial(mill_at, blade), truth, is_blade, 100)
