"""Panoramas against the pinhole, against geometry worked out here, and against themselves turned."""

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from megalopta.render.scene_renderer import SceneRenderer
from megalopta.render.settings import RenderSettings
from megalopta.scenes.cameras.opencv import OpenCVCamera
from megalopta.scenes.cameras.panoramic import CylindricalCamera, EquirectangularCamera
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.scene import Lighting, Scene
from megalopta.scenes.spectra.spectrum import flat
from megalopta.scenes.trajectories.steady import Trajectory

from .conftest import glowing_room, scene_of, sphere_cap
from .truth.oracle import BOTH, eye, plane_hit, sphere_hit

SPHERE = EquirectangularCamera(width=144, height=72)
CYLINDER = CylindricalCamera(width=144, height=60, lower_deg=-50, upper_deg=45)
SECTOR = CylindricalCamera(width=100, height=60, fov_deg=150, lower_deg=-50, upper_deg=30)
PINHOLE = PerspectiveCamera(width=48, height=36, fov_deg=60)
ROOM = Trajectory(frames=3, position_m=(0.3, -0.2, 0.4), look_at_m=(3, 1, 0.9))


def renderer_of(camera, scene, samples=16, **settings):
    settings = RenderSettings(
        samples_per_pixel=samples, bands_nm=((500, 600),), max_depth=2, **settings
    )
    return SceneRenderer(scene, camera, settings)


@pytest.mark.parametrize("backend", ["auto", "scalar"])
@pytest.mark.parametrize("camera", [SPHERE, CYLINDER, SECTOR, PINHOLE], ids=lambda c: c.kind)
def test_uniform_radiance_is_uniform_in_every_camera(camera, backend):
    sky = Scene({}, {}, (), Lighting(flat(2e-9)))
    image = renderer_of(camera, sky, 4, backend=backend).radiance(ROOM.poses()[0], 1)
    # Flat light in one band has no noise at all: float32 rounding remains.
    np.testing.assert_allclose(image, 2e-9, rtol=1e-5)


@cache
def pinhole_view():
    return renderer_of(PINHOLE, glowing_room(), 256).radiance(ROOM.poses()[0], 2)[..., 0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "camera",
    [
        EquirectangularCamera(width=720, height=180, lower_deg=-45, upper_deg=45),
        CylindricalCamera(width=720, height=230),
        OpenCVCamera(
            width=300,
            height=240,
            fx_px=200,
            fy_px=190,
            cx_px=140,
            cy_px=125,
            distortion=(-0.2, 0.03, 0.002, 0.001, 0.0),
        ),
    ],
    ids=lambda camera: camera.kind,
)
def test_a_panorama_resampled_is_the_perspective_view(camera):
    pose = ROOM.poses()[0]
    panorama = renderer_of(camera, glowing_room(), 16).radiance(pose, 1)[..., 0]
    view = pinhole_view()
    # Each pixel of the pinhole is the mean over 4 × 4 directions inside of it.
    fine = PINHOLE.model_copy(update={"width": 4 * PINHOLE.width, "height": 4 * PINHOLE.height})
    x, y = np.moveaxis(camera.project(fine.directions()), -1, 0) - 0.5
    values = map_coordinates(panorama, [y, x], order=3, mode="grid-wrap")
    resampled = values.reshape(PINHOLE.height, 4, PINHOLE.width, 4).mean(axis=(1, 3))
    # Noise of both images and interpolation leave 0.65 % of the contrast; the edges of the room
    # are not smooth and left out with the worst twentieth.
    difference = np.abs(resampled - view) / view.std()
    assert np.quantile(difference, 0.95) < 0.02
    assert np.median(np.abs(resampled[:, ::-1] - view) / view.std()) > 0.3
    assert np.median(np.abs(resampled[::-1] - view) / view.std()) > 0.3


def rays(camera, axes):
    """Directions through the pixel centers by spherical coordinates; not of unit length."""
    azimuth = np.radians(camera.fov_deg) * ((np.arange(camera.width) + 0.5) / camera.width - 0.5)
    lower, upper = np.radians([camera.lower_deg, camera.upper_deg])
    share = (np.arange(camera.height) + 0.5)[:, None] / camera.height
    if camera.kind == "cylindrical":
        elevation = np.arctan(np.tan(upper) + share * (np.tan(lower) - np.tan(upper)))
    else:
        elevation = upper + share * (lower - upper)
    level = (
        np.cos(elevation) * np.stack(np.broadcast_arrays(np.sin(azimuth), np.cos(azimuth)))[:, None]
    )
    right, forward = level
    down = np.broadcast_to(-np.sin(elevation), right.shape)
    return np.stack([right, down, forward], axis=-1) @ axes


def analytic_flow(camera, trajectory, frame, other, distance_along):
    """Flow (H, W, 2) and the elevation (H, W) at which the other camera sees the point."""
    position, axes = eye(trajectory, frame)
    directions = rays(camera, axes)
    points = position + distance_along(position, directions)[..., None] * directions
    position, axes = eye(trajectory, other)
    x, y, z = np.moveaxis((points - position) @ axes.T, -1, 0)
    column = (np.arctan2(x, z) / np.radians(camera.fov_deg) + 0.5) * camera.width
    tangents = -y / np.hypot(x, z)
    lower, upper = np.radians([camera.lower_deg, camera.upper_deg])
    if camera.kind == "cylindrical":
        share = (np.tan(upper) - tangents) / (np.tan(upper) - np.tan(lower))
    else:
        share = (upper - np.arctan(tangents)) / (upper - lower)
    u = column - np.arange(camera.width) - 0.5
    if camera.fov_deg == 360:
        u -= camera.width * np.round(u / camera.width)
    v = share * camera.height - np.arange(camera.height)[:, None] - 0.5
    return np.stack([u, v], axis=-1), np.arctan(tangents)


@pytest.mark.slow
@pytest.mark.parametrize(
    "camera",
    [EquirectangularCamera(width=360, height=180), CYLINDER, SECTOR],
    ids=["whole sphere", "cylinder", "sector"],
)
@pytest.mark.parametrize("surface", ["plane", "ball"])
def test_flow_of_a_panorama_is_analytic_within_1e_4_px(camera, surface, ground):
    center = np.array([4.0, 1.2, 0.8])
    if surface == "plane":
        mesh, distance = ground, plane_hit
    else:
        mesh = sphere_cap(center, 2.0, np.asarray(BOTH.position_m))
        distance = sphere_hit(center, 2.0)
    truth = renderer_of(camera, scene_of(Lighting(flat(1e-9)), mesh), 1).truth(BOTH.poses(), 1)
    seen = truth.object_id == 1
    assert seen.sum() > 100
    for flow, other in ((truth.flow_forward, 2), (truth.flow_backward, 0)):
        expected, elevation = analytic_flow(camera, BOTH, 1, other, distance)
        error = np.abs(flow - expected)
        error[..., 0] *= np.cos(elevation)  # columns crowd at the poles
        assert error[seen].max() < 1e-4
