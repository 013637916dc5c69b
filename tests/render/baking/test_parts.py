"""Cells, clusters, scattering and kept light that baking is made of."""

import numpy as np
import pytest

from megalopta.render import activate, choose_variant, dr, mi
from megalopta.render.baking import cells as cells_module
from megalopta.render.baking.cells import VIEWS, CellFinder, Cells, survey, views
from megalopta.render.baking.choice import pilot
from megalopta.render.baking.gathering import Scattering
from megalopta.render.baking.light import smoothed
from megalopta.render.loading.meshes import MergedMesh
from megalopta.render.loading.scene import load_scene
from megalopta.scenes import PerspectiveCamera, Scene, Trajectory
from megalopta.scenes.material import Emission, Material, Texture
from megalopta.scenes.spectra.spectrum import Spectrum, flat

from ..conftest import vectorized

CAMERA = PerspectiveCamera(width=64, height=64, fov_deg=60)
THING = Scene({"thing": Material(flat(0.5))}, {}, ())
PATH = np.array([[0.0, 0.0, 1.0], [3.0, 0.0, 1.0]])


@pytest.fixture(autouse=True)
def coarse_pieces(monkeypatch):
    """Few cells, so that some faces here are one."""
    monkeypatch.setattr(cells_module, "PIECE_PX", 4.0)


def triangle_mesh(corners, normals=None):
    count = len(corners)
    return MergedMesh(
        "thing",
        np.reshape(corners, (-1, 3)).astype(np.float32),
        np.arange(3 * count, dtype=np.uint32).reshape(count, 3),
        normals,
        None,
        np.ones(count, np.uint32),
    )


def random_triangles(count=200):
    rng = np.random.default_rng(1)
    center = rng.uniform(-3, 3, (count, 1, 3))
    return center + rng.normal(size=(count, 3, 3)) * rng.uniform(0.01, 1, (count, 1, 3))


def test_no_piece_is_longer_than_its_pixels_at_the_nearest_camera():
    corners = random_triangles()
    cells = Cells.of([triangle_mesh(corners)], CAMERA, PATH)
    faces = np.arange(len(corners))
    start, middle, end = (corners[faces, (cells.origin + k) % 3] for k in range(3))
    edges = [np.linalg.norm(middle - start, axis=1), np.linalg.norm(end - start, axis=1)]
    # A bound from geometry alone: no point of a triangle is nearer than its nearest corner less
    # the longest edge.
    reach = np.max(edges, axis=0) + np.linalg.norm(end - middle, axis=1)
    nearest = np.linalg.norm(corners[:, :, None] - PATH, axis=-1).min(axis=(1, 2)) + reach
    pixel = np.radians(60) / 64
    assert (np.array(edges) / cells.pieces <= 1.3 * cells_module.PIECE_PX * pixel * nearest).all()
    assert cells.pieces.max() > 5 > cells.pieces.min() == 1


def test_normals_that_turn_cut_a_face_further():
    corners = [[[2, 0, 0], [2, 0.3, 0], [2, 0, 0.3]]]
    even = np.tile([1, 0, 0], (3, 1)).astype(np.float32)
    bent = even.copy()
    bent[1] = [0, 1, 0]
    flat_cells, bent_cells = (
        Cells.of([triangle_mesh(corners, normals)], CAMERA, PATH) for normals in (even, bent)
    )
    # A right angle at 0.25 rad a piece; the other edge does not turn.
    assert flat_cells.pieces.max() < 7
    assert sorted(bent_cells.pieces[:, 0]) == [flat_cells.pieces.min(), 7]


@vectorized
def test_a_survey_counts_512_rays_per_pixel_however_long_the_sequence():
    activate(choose_variant())
    floor = triangle_mesh([[[-900, -900, 0], [900, -900, 0], [0, 900, 0]]])
    loaded = load_scene(THING, [floor])
    down = Trajectory(frames=7, position_m=(0, 0, 2), look_at_m=(0, 0, 0), up=(1, 0, 0))
    cells = Cells.of([floor], CAMERA, down.poses()[:, :3, 3])
    rays = views(CAMERA, down.poses(), VIEWS, 0)
    cell, seen, _ = survey(loaded, CellFinder(cells, loaded), rays)
    assert seen.sum() == 512 * CAMERA.width * CAMERA.height
    assert (np.diff(cell) > 0).all()
    assert cell[-1] < cells.count // 2  # not the back


BANDS = ((400.0, 500.0), (700.0, 900.0))
RISING = Spectrum((400.0, 900.0), (0.0, 0.5))
WEIGHT = np.zeros((2, 2), np.float32)
MATERIALS = {
    "opaque": Material(RISING),
    "leaf": Material(RISING, Texture(WEIGHT, flat(0.4), flat(0.3)), transmittance=RISING),
    "little comes through": Material(flat(0.9), transmittance=flat(0.01)),
    "glows": Material(flat(0.5), None, Emission(1.0), flat(0.5)),
    "black": Material(flat(0.0)),
}
SCATTERING = Scattering(list(MATERIALS.values()), BANDS)
INDEX = {name: index for index, name in enumerate(MATERIALS)}


@pytest.mark.parametrize("name", MATERIALS)
def test_what_rays_count_makes_up_for_how_many_there_are(name):
    material, share = MATERIALS[name], SCATTERING.through[INDEX[name]]
    counted = SCATTERING.of_rays()[INDEX[name]]
    expected = [material.reflectance, material.transmittance or flat(0.0)]
    if material.emission:
        expected = [flat(0.0), flat(0.0)]
    for side, spectrum in enumerate(expected):
        mean = (share if side else 1 - share) * counted[side, 0].mean(axis=-1)
        found = [spectrum(np.linspace(*band, 1001)).mean() for band in BANDS]
        np.testing.assert_allclose(mean, found, 1e-6, 1e-12)


RNG = np.random.default_rng(5)
GROUPS, SIZE, RAYS = 400, 20, 16
NEIGHBORS = np.repeat(np.arange(GROUPS, dtype=np.uint64), SIZE)
EVEN = np.full(GROUPS * SIZE, RAYS)
SEEN = np.full(GROUPS * SIZE, 3)


def measured(truth, sigma):
    """Rows of one value whose halves have the error σ·√2 each."""
    halves = truth[:, None] + RNG.normal(0, sigma * np.sqrt(2), (len(truth), 2))
    return np.stack([halves.mean(axis=1), (halves[:, 0] - halves[:, 1]) / 2], axis=1)


@pytest.mark.parametrize("contrast", [0.0, 0.3, 0.5, 1.0, 3.0, 10.0])
def test_what_is_left_is_the_least_error_of_a_known_contrast(contrast):
    truth = 5 + RNG.normal(0, contrast, GROUPS * SIZE)
    better = smoothed(measured(truth, 1.0), NEIGHBORS, EVEN, SEEN)
    # Of the noise 1 and the contrast τ² the part τ²/(τ² + 1) is left, and 1/20 of the rest, the
    # noise of the mean; contrasts known from 20 values add up to a tenth of the noise.
    kept = contrast**2 / (contrast**2 + 1)
    least = kept + (1 - kept) / SIZE
    left = np.mean((better[:, 0] - truth) ** 2)
    assert least - 0.05 < left < least + 0.12
    if 0.5 <= contrast <= 3:
        # half differences tell it with what is taken of contrast, whose share is known from 20
        assert 0.65 * left < np.mean(better[:, 1] ** 2) < 1.05 * left


@vectorized
def test_the_fixed_error_of_a_pixel_is_not_that_of_the_few_clusters_that_rays_meet():
    # Each ray meets a cluster of its own, with an error of 1; all of a pixel share 0.1. The square
    # of the mean of 32 rays would be 0.01 + 1 / 32. Tolerance: 5 standard errors of 3 · 4096 px.
    activate(choose_variant("auto"))
    rng = np.random.default_rng(0)
    pixels = CAMERA.width * CAMERA.height
    frames = [list(views(CAMERA, np.eye(4)[None], 32, 0, 1))] * 3

    def look(rays):
        shared = np.tile(0.1 * rng.choice([-1, 1], pixels), 32)
        error = mi.Float((shared + rng.standard_normal(32 * pixels)).astype(np.float32))
        light = mi.Float(1.0 + np.zeros(32 * pixels, np.float32))
        return [light, error, dr.zeros(mi.Float, 32 * pixels)]

    found = pilot(frames, look)
    assert found.mean == 1
    assert found.standing == pytest.approx(0.01, abs=5 * (1 / 16) / (3 * pixels) ** 0.5)
