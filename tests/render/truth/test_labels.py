"""Albedo against Mitsuba's own surfaces, and tracks of points against the flow."""

import numpy as np
import pytest
import trimesh
from trimesh.visual import TextureVisuals

from megalopta.render import dr, mi
from megalopta.render.loading.materials import bsdf
from megalopta.scenes import PerspectiveCamera, Trajectory
from megalopta.scenes.material import ColorTexture, Emission, Material, Texture
from megalopta.scenes.motion import Drift, RigidMotion
from megalopta.scenes.spectra.color import BLUE, GREEN, RED
from megalopta.scenes.spectra.spectrum import Spectrum, flat

from ..conftest import quad, renderer_of

RNG = np.random.default_rng(8)
CAMERA = PerspectiveCamera(width=48, height=36, fov_deg=60)
PATH = Trajectory(
    frames=4,
    position_m=(-4, 0.3, 1),
    look_at_m=(0, 0, 1),
    velocity_m_s=(0, 1.5, 0),
    rotation_deg_s=20,
)
NARROW = tuple((nm - 1e-3, nm + 1e-3) for nm in (450.0, 530.0, 610.0, 700.0))
RISING = Spectrum((400.0, 800.0), (0.1, 0.7))
LEAF = Material(RISING.scaled(0.5), transmittance=RISING.scaled(0.4))
MATERIALS = {
    "plain": Material(RISING),
    "leaf": LEAF,
    "mixed": Material(RISING, Texture(RNG.random((5, 8), np.float32), flat(0.2))),
    "colors": Material(
        flat(0.0), ColorTexture(RNG.random((6, 4, 3), np.float32) * 0.9, (RED, GREEN, BLUE))
    ),
}


def wall(at_x=0.0, half_width=3.0):
    corners = half_width * np.array([[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1.0]])
    mesh = quad(corners + np.array([at_x, 0, 1]))
    mesh.visual = TextureVisuals(uv=np.array([[0, 0], [2.3, 0], [2.3, 1.7], [0, 1.7]]))
    return mesh


@pytest.mark.parametrize("name", MATERIALS)
def test_albedo_is_that_of_mitsuba_s_surface(name):
    material = MATERIALS[name]
    found = renderer_of(CAMERA, (wall(), material), bands_nm=NARROW).albedo(PATH.poses()[0])
    # The same pixels through the plug-in: light along the normal is reflected as ρ/π.
    origin, rotation = PATH.poses()[0][:3, 3], PATH.poses()[0][:3, :3]
    ways = CAMERA.directions().reshape(-1, 3) @ rotation.T
    place = origin + ways * (-origin[0] / ways[:, :1])
    inside = (np.abs(place[:, 1:] - [0, 1]) < 3).all(axis=1)
    assert inside.mean() > 0.5
    uv = (place[inside, 1:] - [-3, -2]) / 6 * [2.3, 1.7]
    is_scalar = mi.variant().startswith("scalar")
    surface = mi.load_dict(bsdf(material))

    def reflected(uv):
        point = dr.zeros(mi.SurfaceInteraction3f, *(() if is_scalar else (len(uv[0]),)))
        point.uv = mi.Point2f(*uv)
        point.wi = mi.Vector3f(0, 0, 1)
        point.wavelengths = mi.Spectrum([nm for nm, _ in NARROW])
        return np.array(surface.eval(mi.BSDFContext(), point, mi.Vector3f(0, 0, 1))) * np.pi

    expected = np.array([reflected(each) for each in uv]) if is_scalar else reflected(uv.T).T
    # Texture coordinates and texels are float32.
    error = found.reshape(-1, 4)[inside] - expected
    np.testing.assert_allclose(error, 0, atol=2e-5)
    assert (found.reshape(-1, 4)[~inside] == 0).all()


def test_albedo_is_the_mean_over_a_band_and_lamps_have_none():
    lamp = Material(flat(0.5), emission=Emission(1.0))
    things = (wall(), Material(RISING)), (wall(-1, 0.5), lamp)
    found = renderer_of(CAMERA, *things, bands_nm=((400, 500), (600, 800))).albedo(PATH.poses()[0])
    np.testing.assert_allclose(found[2, 24], [0.175, 0.55], rtol=1e-6)
    assert not found[18, 24].any()


def test_tracks_agree_with_the_flow_between_any_two_frames():
    # A small ball flies past before a wall.
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.4).apply_translation([-1, 1, 1])
    motion = RigidMotion((-1, 1, 1), Drift(velocity_m_s=(0, -4, 0), spin_deg_s=90))
    renderer = renderer_of(CAMERA, wall(), (ball, Material(flat(0.3)), motion))
    poses, times = PATH.poses(), PATH.times_s
    image = CAMERA.pixel_centers().reshape(-1, 2)
    tracks = renderer.tracks(poses, 1, image, times)
    for frame in range(4):
        flow = renderer.flow(poses, 1, frame, times)
        # Flow is stored as float32.
        expected = image + flow.displacement.reshape(-1, 2)
        np.testing.assert_allclose(tracks.points[:, frame], expected, atol=1e-5)
        hidden = (flow.occluded | flow.out_of_view).ravel()
        np.testing.assert_array_equal(tracks.occluded[:, frame], hidden)
    assert 0.02 < tracks.occluded[:, 3].mean() < 0.9
    assert not tracks.occluded[:, 1].any()
    np.testing.assert_allclose(tracks.points[:, 1], image, atol=1e-9)


def test_tracks_between_pixels_are_projections_of_points_on_the_wall():
    image = RNG.uniform([10, 8], [38, 28], (50, 2))
    tracks = renderer_of(CAMERA, wall(half_width=50)).tracks(PATH.poses(), 0, image)
    way = CAMERA.toward(image) @ PATH.poses()[0][:3, :3].T
    origin = PATH.poses()[0][:3, 3]
    points = origin + way * (-origin[0] / way[:, :1])
    for frame, pose in enumerate(PATH.poses()):
        expected = CAMERA.project((points - pose[:3, 3]) @ pose[:3, :3])
        np.testing.assert_allclose(tracks.points[:, frame], expected, atol=1e-6)


def test_leaf_clusters_are_those_of_the_triangles_seen():
    leaves, moving = wall(0.0, 1.5), wall(-1.0, 0.4)
    leaves.metadata["clusters"] = np.array([3, 7])
    moving.metadata["clusters"] = np.array([5, 5])
    motion = RigidMotion((-1.0, 0.0, 1.0), Drift(velocity_m_s=(0.0, 0.5, 0.0)))
    things = (wall(2.0, 9.0), leaves, (moving, LEAF, motion))
    renderer, poses, times = renderer_of(CAMERA, *things), PATH.poses(), PATH.times_s
    truth = renderer.truth(poses, 2, times)
    x, y, z = np.moveaxis(truth.position, -1, 0)
    on_wall = np.where(y > z - 1, 3, 7)
    expected = np.choose(truth.object_id, [0, 0, on_wall, 5])
    assert {*np.unique(expected)} == {0, 3, 5, 7}
    clear = (x != 0) | (np.abs(y - z + 1) > 1e-6)
    found = renderer.leaf_clusters(poses[2], times[2])
    np.testing.assert_array_equal(found[clear], expected[clear])
    assert clear.mean() > 0.99
