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
SHARP = PerspectiveCamera(width=64, height=48, fov_deg=40)
CAMERA = SHARP.model_copy(update=LENS)
BARREL = OpenCVCamera(
    width=64, height=48, fx_px=90, fy_px=80, cx_px=31.5, cy_px=23.5, distortion=(-0.2, 0.03, 0, 0, 0),
    **LENS,
)  # fmt: skip
PATH = Trajectory(
    frames=2, position_m=(0, 0, 0), look_at_m=(1, 0, 0), velocity_m_s=(0, 0, 0), frame_rate_hz=10
)
POSES = PATH.poses()
GLOW = Material(flat(0.0), None, Emission(1e-6))


def plate(distance, half=0.05):
    """A square plate ahead of the camera, as large in the image at any distance."""
    side = half * distance
    across = np.array([[side, -side], [-side, -side], [-side, side], [side, side]])
    return quad(np.column_stack([np.full(4, distance), across]))


def radius_of(distance, focal_px):
    """Radius of the circle of confusion from the lens equation, px, for any focal length (m)."""
    focal_m = 0.05
    sensor_m, image_m = (1 / (1 / focal_m - 1 / z) for z in (FOCUS, distance))
    return APERTURE / 2 * abs(image_m - sensor_m) / image_m / (sensor_m / focal_px)


def spread(image, camera):
    """Sum of an image (H, W), and its variance (2,) across columns and rows, px²."""
    share = image.astype(np.float64) / image.sum()
    places = camera.pixel_centers()
    mean = np.einsum("ij,ijk->k", share, places)
    return float(image.sum()), np.einsum("ij,ijk->k", share, (places - mean) ** 2)


def taken(scene, camera, how):
    """Image (H, W) of the plate, by the pixels' light or their share without sky."""
    settings = RenderSettings(samples_per_pixel=1024, bands_nm=((500, 600),), max_depth=1)
    renderer = SceneRenderer(scene, camera, settings)
    if how == "rolling":
        shutter = Shutter(exposure_s=0.02, readout_s=0.02)
        return renderer.exposed(PATH, shutter, 0, seed=1)[..., 0]
    return 1 - renderer.measured(POSES[0], seed=1).sky if how == "sky" else (
        renderer.radiance(POSES[0], seed=1)[..., 0] * 1e6
    )  # fmt: skip


@pytest.mark.parametrize("distance", [1.0, 4.0])
@pytest.mark.parametrize(
    ("camera", "how"),
    [(CAMERA, "light"), (CAMERA, "rolling"), (CAMERA, "sky"), (BARREL, "light")],
    ids=["pinhole", "rolling", "sky", "barrel"],
)
def test_a_plate_is_blurred_to_the_disc_of_the_lens_equation(distance, camera, how):
    thing = plate(distance) if how == "sky" else (plate(distance), GLOW)
    scene = scene_of(EVEN if how == "sky" else None, thing)
    sharp = camera.model_copy(update=dict.fromkeys(LENS))
    (light, wide), (all_of_it, narrow) = (
        spread(taken(scene, each, how), each) for each in (camera, sharp)
    )
    # A disc of radius r has a variance of r²/4 along each axis.
    radii = 2 * np.sqrt(wide - narrow)
    expected = [radius_of(distance, f) for f in np.broadcast_to(focal(camera), 2)]
    # The plate takes some 80,000 samples, which tells the radius to 1 %, and the light better.
    np.testing.assert_allclose(radii, expected, rtol=0.06)
    assert light == pytest.approx(all_of_it, rel=0.02)


def focal(camera):
    return (camera.fx_px, camera.fy_px) if camera is BARREL else camera.focal_length_px


def test_in_focus_the_image_is_that_of_a_pinhole():
    scene = scene_of(None, (plate(FOCUS), GLOW))
    with_lens, without = (taken(scene, camera, "light") for camera in (CAMERA, SHARP))
    # Rays through the same points of the plane in focus: but for rounding on its edges, the same.
    assert np.abs(with_lens - without).mean() < 1e-3


@pytest.mark.parametrize("camera", [CAMERA, BARREL])
def test_truth_is_that_of_the_ray_through_the_middle_with_the_radius_of_the_blur(camera, ground):
    poses = Trajectory(
        frames=2, position_m=(0, 0, 2), look_at_m=(9, 0, 1), velocity_m_s=(1, 1, 0), frame_rate_hz=5
    ).poses()
    sharp = camera.model_copy(update=dict.fromkeys(LENS))
    camera = camera.model_copy(update={"aperture_mm": 2.0})  # images of its diameters are straight
    truth, pinhole = (renderer_of(each, ground).truth(poses, 0) for each in (camera, sharp))
    for name in Truth.__dataclass_fields__.keys() - {"blur", "footprint"}:
        np.testing.assert_array_equal(getattr(truth, name), getattr(pinhole, name))
    assert pinhole.blur is None and np.isfinite(truth.blur).all()
    # Images of the ends of two diameters of the opening, through the point, in the plane in focus.
    axes = camera.directions() / camera.directions()[..., 2:]
    ways = []
    for end in 1e-3 * np.array([[1.0, 0, 0], [0, 1, 0]]):
        sides = (FOCUS * axes + s * end * (1 - FOCUS / truth.depth[..., None]) for s in (1, -1))
        first, second = map(camera.project, sides)
        ways.append((first - second) / 2)
    across, down = ways
    area = np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0])
    np.testing.assert_allclose(truth.blur, np.sqrt(area), rtol=1e-3, atol=1e-6)


@vectorized
def test_cells_are_surveyed_through_the_whole_opening():
    activate(choose_variant("auto"))
    rays = list(views(CAMERA, POSES[:1], 512, 0, step=64))
    starts = np.array([np.array(ray.o).ravel() for ray in rays])
    # Uniform on a disc across the view: the mean square is r²/2. Tolerance: 6 standard errors.
    assert np.abs(starts[:, 0]).max() < 1e-9
    square = (starts**2).sum(axis=1) / (APERTURE / 2) ** 2
    assert square.max() <= 1 + 1e-6
    assert square.mean() == pytest.approx(0.5, abs=6 / (12 * 512) ** 0.5)
    ends = [FOCUS * np.array(ray.d) / np.array(ray.d)[0] + np.array(ray.o) for ray in rays]
    # All meet the plane in focus within half a pixel along each axis, turned about three.
    assert np.ptp(ends, axis=0).max() < 2 * FOCUS / CAMERA.focal_length_px


@pytest.mark.slow
@vectorized
def test_split_paths_and_baked_light_are_seen_through_the_lens_as_by_mitsuba(ground):
    wall = (plate(1.0, 0.2), Material(flat(0.8)))
    poses = Trajectory(frames=2, position_m=(-1, 0, 1), look_at_m=(9, 0, 0)).poses()
    images = [
        renderer_of(
            CAMERA, ground, wall, poses=poses, samples_per_pixel=256, integrator=kind,
            bake_error=0.003, backend=backend,
        ).radiance(poses[0], 1)
        for kind, backend in (("baked", "auto"), ("path", "auto"), ("path", "scalar"))
    ]  # fmt: skip
    baked, split, plain = (image.reshape(6, 8, 8, 8).mean(axis=(1, 3)) for image in images)
    np.testing.assert_allclose(baked, plain, rtol=0.03)
    np.testing.assert_allclose(split, plain, rtol=0.03)
