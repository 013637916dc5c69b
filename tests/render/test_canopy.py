"""Light in open forests of leafy spheres."""

import math

import numpy as np
import pytest
import trimesh

from megalopta.render import activate, choose_variant, mi
from megalopta.render.loading.meshes import merge
from megalopta.render.loading.scene import load_scene
from megalopta.render.truth import rays
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Lighting, Sun
from megalopta.scenes.spectra.spectrum import flat

from .conftest import scene_of


def leaves(middle, area, rng):
    """Squares that face anywhere: corners (n, 4, 3)."""
    edges = np.linalg.qr(rng.normal(size=(len(middle), 3, 3)))[0][:, :, :2]
    rim = edges @ (math.sqrt(area) / 2 * np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]]))
    return (middle[:, :, None] + rim).transpose(0, 2, 1)


def mesh_of(corners):
    faces = 4 * np.arange(len(corners))[:, None, None] + [[0, 1, 2], [0, 2, 3]]
    return trimesh.Trimesh(corners.reshape(-1, 3), faces.reshape(-1, 3), process=False)


RADIUS, CENTER_M, BOTTOM_M, TOP_M = 5.0, (7.0, 11.0), 1.9, 16.1
CROWN_AREA_INDEX, LEAF_M2 = 5.0, math.pi * 0.1**2
SPHERES, PLACINGS = 12, 3
RED = 0.0735, 0.0566  # reflectance, transmittance of a leaf
MARGIN_M = 12.0
PLACES, FILM_PX = 400, 192


def standing(cover, rng):
    """Side of a square plot and centers (SPHERES, 3) of spheres that cover a share of it."""
    side = math.sqrt(SPHERES * math.pi * RADIUS**2 / cover)
    while True:
        centers = np.zeros((0, 3))
        for _ in range(4000):
            drawn = rng.uniform((0, 0, CENTER_M[0]), (side, side, CENTER_M[1]))
            apart = centers - drawn
            apart[:, :2] -= side * np.round(apart[:, :2] / side)  # the plot goes on forever
            if np.all(np.linalg.norm(apart, axis=1) > 2 * RADIUS):
                centers = np.vstack([centers, drawn])
            if len(centers) == SPHERES:
                return side, centers


def crown(center, rng):
    """Leaves of a sphere: corners (n, 4, 3) of squares."""
    count = round(CROWN_AREA_INDEX * math.pi * RADIUS**2 / LEAF_M2)
    toward = rng.normal(size=(count, 3))
    toward *= RADIUS * rng.random((count, 1)) ** (1 / 3) / np.linalg.norm(toward, axis=1)[:, None]
    return leaves(center + toward, LEAF_M2, rng)


def forest(side, centers, rng, zenith_deg):
    """The scene of a plot, with what of its neighbors shades it or is seen from it."""
    angle = math.radians(zenith_deg)
    found = []
    for shift in np.ndindex(5, 5):
        copies = centers + side * np.array([shift[0] - 2, shift[1] - 2, 0])
        low = copies[:, :2] > -RADIUS - MARGIN_M
        beyond = np.array([MARGIN_M + TOP_M * math.tan(angle), MARGIN_M])
        high = copies[:, :2] < side + RADIUS + beyond
        found += [crown(center, rng) for center in copies[(low & high).all(axis=1)]]
    mesh = mesh_of(np.concatenate(found))
    sun = Sun((math.sin(angle), 0.0, math.cos(angle)), flat(1.0 / math.cos(angle)))
    material = Material(flat(RED[0]), transmittance=flat(RED[1]))
    return scene_of(Lighting(flat(0.0), sun), (mesh, material))


def shares(side, scene):
    """Shares of the sunlight that are absorbed, reflected and transmitted."""
    activate(choose_variant())
    loaded = load_scene(scene, merge(scene))
    sun, grid = scene.lighting.sun, (np.arange(PLACES) + 0.5) / PLACES * side
    places = np.stack(
        [*(each.ravel() for each in np.meshgrid(grid, grid)), np.zeros(PLACES**2)], -1
    )
    toward = np.tile(sun.direction, (len(places), 1))
    seen = ~np.asarray(rays.is_hidden(loaded, places, toward, np.full(len(places), np.inf)))
    through = seen.mean() + _irradiance(loaded, side, 0.0, upward=True)
    back = _irradiance(loaded, side, TOP_M, upward=False)
    return 1 - back - through, back, through


def _irradiance(loaded, side, height, upward):
    """Of a plate over the plot, without what comes straight from the sun."""
    half = side / 2
    to_world = np.array([[half, 0, 0, half], [0, half, 0, half], [0, 0, 1, height], [0, 0, 0, 1]])
    if not upward:
        to_world[:, 1:3] *= -1
    band = {"type": "spectrum", "value": [(600.0, 0.01), (700.0, 0.01)]}
    film = {
        "type": "specfilm",
        "width": FILM_PX,
        "height": FILM_PX,
        "rfilter": {"type": "box"},
        "red": band,
    }
    meter = {"type": "irradiancemeter", "film": {**film, "component_format": "float32"}}
    plate = mi.load_dict(
        {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(to_world.tolist()),
            "meter": {**meter, "sampler": {"type": "independent", "sample_count": 16}},
        }
    )
    path = mi.load_dict({"type": "path", "max_depth": 6})
    return float(np.array(path.render(loaded, plate.sensor(), seed=1), np.float64).mean())


def rendered(area_index, zenith_deg):
    """Mean shares of some plots."""
    found = []
    for seed in range(1, PLACINGS + 1):
        rng = np.random.default_rng(seed)
        side, centers = standing(area_index / CROWN_AREA_INDEX, rng)
        found.append(shares(side, forest(side, centers, rng, zenith_deg)))
    return np.mean(found, axis=0)


# Of what is reflected at an index of 1.5 the figure for 27° alone is at hand.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("area_index", "zenith_deg", "published"),
    [
        (1.5, 27, (0.2814, 0.0092, 0.7094)),
        (2.5, 27, (0.4685, 0.0145, 0.5170)),
        (1.5, 60, (0.4651, None, 0.5211)),
        (2.5, 60, (0.7043, 0.0202, 0.2756)),
    ],
)  # fmt: skip
def test_an_open_forest_absorbs_reflects_and_transmits_its_published_shares(
    area_index, zenith_deg, published
):
    # Required: 2 %. From one placing of spheres to the next, shares at 27° differ by 0.5, 1 and
    # 0.4 % (σ).
    for share, expected in zip(rendered(area_index, zenith_deg), published, strict=True):
        assert expected is None or share == pytest.approx(expected, rel=0.02)
