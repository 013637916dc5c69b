"""Blur by a thin lens against closed forms: radius, light, focus, truth."""

import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.render.baking.cells import views
from megalopta.render.mitsuba_loader import activate
from megalopta.render.truth.tracer import Truth
from megalopta.render.variant import choose_variant
from megalopta.scenes import OpenCVCamera, PerspectiveCamera, Shutter, Trajectory
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.spectra.spectrum import flat

from .conftest import EVEN, quad, renderer_of, scene_of, vectorized

FOCUS, APERTURE = 2.0, 0.3
LENS = {"aperture_mm": 1e3 * APERTURE, "focus_m": FOCUS}
CAMERA = PerspectiveCamera(width=64, height=48, fov_deg=40, **LENS)
SIZE = {"width": 64, "height": 48, "fx_px": 90, "fy_px": 80, "cx_px": 31.5, "cy_px": 23.5}
BARREL = OpenCVCamera(**SIZE, distortion=(-0.2, 0.03, 0, 0, 0), **LENS)
EYE = np.array([0.0, -3.0, 1.5])
PATH = Trajectory(frames=2, position_m=EYE, look_at_m=(1, -3, 1.5), velocity_m_s=(0, 0, 0))
GLOW = Material(flat(0.0), None, Emission(1.0))


def plate(distance, half=0.05):
    """A square plate ahead of the camera, as large in the image at any distance."""
    across = half * distance * np.array([[1, -1], [-1, -1], [-1, 1], [1, 1]])
    return quad(EYE + np.column_stack([np.full(4, distance), across]))


def radius_of(distance, focal_px):
    """Radius of the circle of confusion from the lens equation, px, for any focal length (m)."""
    sensor_m, image_m = (1 / (1 / 0.05 - 1 / z) for z in (FOCUS, distance))
    return APERTURE / 2 * abs(image_m - sensor_m) / image_m / (sensor_m / focal_px)


def spread(image):
    """Variance (2,) of an image (48, 64) along columns and rows, px²."""
    marginals = [(np.arange(image.shape[k]), image.sum(axis=1 - k)) for k in (0, 1)]
    means = [np.average(x, weights=w) for x, w in marginals]
    return np.array(
        [np.average((x - m) ** 2, weights=w) for (x, w), m in zip(marginals, means, strict=True)]
    )


def pinhole(camera):
    return camera.model_copy(update=dict.fromkeys(LENS))


def taken(distance, camera, how="light"):
    """Image (H, W) of the plate, by its light or the pixels' share without sky."""
    settings = RenderSettings(samples_per_pixel=1024, bands_nm=((500, 600),), max_depth=1)
    thing = plate(distance) if how == "sky" else (plate(distance), GLOW)
    renderer = SceneRenderer(scene_of(EVEN if how == "sky" else None, thing), camera, settings)
    if how == "rolling":
        return renderer.exposed(PATH, Shutter(exposure_s=0.02, readout_s=0.02), 0, seed=1)[..., 0]
    image = renderer.measured(PATH.poses()[0], seed=1)
    return (1 - image.sky if how == "sky" else image.radiance[..., 0]).astype(float)


@pytest.mark.parametrize("distance", [1.0, 4.0])
@pytest.mark.parametrize("camera", [CAMERA, BARREL], ids=["perspective", "barrel"])
@pytest.mark.parametrize("how", ["light", "rolling", "sky"])
def test_a_plate_is_blurred_to_the_disc_of_the_lens_equation(distance, camera, how):
    blurred, sharp = (taken(distance, each, how) for each in (camera, pinhole(camera)))
    # A disc of radius r has a variance of r²/4 along each axis. The plate takes some 80,000
    # samples, which tells the radius to 1 %, and the light better.
    focal_px = (80, 90) if camera is BARREL else (camera.focal_length_px,) * 2
    expected = [radius_of(distance, f) for f in focal_px]
    np.testing.assert_allclose(2 * np.sqrt(spread(blurred) - spread(sharp)), expected, rtol=0.06)
    assert blurred.sum() == pytest.approx(sharp.sum(), rel=0.02)


def test_in_focus_the_image_is_that_of_a_pinhole():
    # Rays meet the plane in focus in the same points: but for rounding on edges, nothing differs.
    with_lens, without = (taken(FOCUS, camera) for camera in (CAMERA, pinhole(CAMERA)))
    assert np.abs(with_lens - without).mean() < 1e-3 * without.max()


@pytest.mark.parametrize("camera", [CAMERA, BARREL], ids=["perspective", "barrel"])
def test_truth_is_that_of_the_middle_of_the_lens_with_the_radius_of_the_blur(camera, ground):
    path = {"position_m": (0, 0, 2), "look_at_m": (9, 0, 1), "velocity_m_s": (1, 1, 0)}
    # The images of diameters of a narrow lens are straight.
    narrow, poses = (
        camera.model_copy(update={"aperture_mm": 2.0}),
        Trajectory(frames=2, **path).poses(),
    )
    truth, sharp = (renderer_of(c, ground).truth(poses, 0) for c in (narrow, pinhole(camera)))
    for name in Truth.__dataclass_fields__.keys() - {"blur", "footprint"}:
        np.testing.assert_array_equal(getattr(truth, name), getattr(sharp, name))
    assert sharp.blur is None and (truth.object_id == 0).any()
    # Two radii of the lens, seen through the point in the plane in focus.
    axes = FOCUS * camera.directions() / camera.directions()[..., 2:]
    ends = 1e-3 * np.eye(3)[:2, None, None] * (1 - FOCUS / truth.depth[..., None])
    ways = (camera.project(axes + ends) - camera.project(axes - ends)) / 2
    area = np.abs(np.linalg.det(ways.transpose(1, 2, 0, 3)))
    np.testing.assert_allclose(truth.blur, np.sqrt(area), rtol=1e-3, atol=1e-6)


@vectorized
def test_cells_are_surveyed_through_the_whole_lens():
    activate(choose_variant("auto"))
    rays = list(views(CAMERA, PATH.poses()[:1], 512, 0, step=64))
    starts, directions = (
        np.array([np.array(x) for x in xs]) for xs in zip(*((r.o, r.d) for r in rays), strict=True)
    )
    square = ((starts[:, :, 0] - EYE) ** 2).sum(axis=1) / (APERTURE / 2) ** 2
    # Uniform on a disc: the mean square of the radius is half. Tolerance: 6 standard errors.
    assert square.max() <= 1 + 1e-4
    assert square.mean() == pytest.approx(0.5, abs=6 / (12 * 512) ** 0.5)
    # Turned by half a pixel about three axes, all meet in the plane in focus.
    ends = starts + FOCUS * directions / directions[:, :1]
    assert np.ptp(ends, axis=0).max() < 2 * FOCUS / CAMERA.focal_length_px


@pytest.mark.slow
@vectorized
def test_split_paths_and_baked_light_are_seen_through_the_lens_as_by_mitsuba(ground):
    wall = (plate(1.0, 0.2), Material(flat(0.8)))
    poses = Trajectory(frames=2, position_m=(-1, 0, 1), look_at_m=(9, 0, 0)).poses()
    given = {"poses": poses, "samples_per_pixel": 256, "bake_error": 0.003}
    kinds = ("baked", "auto"), ("path", "auto"), ("path", "scalar")
    images = [
        renderer_of(CAMERA, ground, wall, integrator=kind, backend=backend, **given)
        .radiance(poses[0], 1).reshape(6, 8, 8, 8).mean(axis=(1, 3))
        for kind, backend in kinds
    ]  # fmt: skip
    np.testing.assert_allclose(images[0], images[2], rtol=0.03)
    np.testing.assert_allclose(images[1], images[2], rtol=0.03)
