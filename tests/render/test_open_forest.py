"""Light in open forests of leafy spheres, against published shares (RAMI4PILPS).

Spheres 10 m wide hang 2 to 6 m above black soil, without overlap, and hold leaves at random that
are turned at random; their leaf area is five times their cross-section. The lower the sun, the more
they shade each other, and then shares depend on where they stand, by several percent at 60°: this
is the highest of the published suns.

References
----------
Widlowski et al. (2011), Journal of Geophysical Research 116:G02019.
"""

import math

import numpy as np
import pytest
import trimesh

from megalopta.render import mi
from megalopta.render.loading import load_scene, merge
from megalopta.render.mitsuba_loader import activate
from megalopta.render.truth import rays
from megalopta.render.variant import choose_variant
from megalopta.scenes.spectra import flat
from megalopta.scenes.world import Asset, Lighting, Material, Placement, Scene, Sun

RADIUS, CENTER_M, TOP_M = 5.0, (7.0, 11.0), 16.1
CROWN_AREA_INDEX, LEAF_M2 = 5.0, math.pi * 0.1**2
ZENITH_DEG, SPHERES, PLACINGS = 27.0, 12, 3
RED = Material(flat(0.0735), transmittance=flat(0.0566))
MARGIN_M = 12.0


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
    edges = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0][:, :, :2]
    rim = edges @ (math.sqrt(LEAF_M2) / 2 * np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]]))
    return ((center + toward)[:, :, None] + rim).transpose(0, 2, 1)


def forest(cover, rng):
    """A plot's side and its scene, with what of its neighbors shades it or is seen from it."""
    side, centers = standing(cover, rng)
    angle = math.radians(ZENITH_DEG)
    found = []
    for shift in np.ndindex(5, 5):
        copies = centers + side * np.array([shift[0] - 2, shift[1] - 2, 0])
        low = copies[:, :2] > -RADIUS - MARGIN_M
        beyond = np.array([MARGIN_M + TOP_M * math.tan(angle), MARGIN_M])
        high = copies[:, :2] < side + RADIUS + beyond
        found += [crown(center, rng) for center in copies[(low & high).all(axis=1)]]
    corners = np.concatenate(found)
    faces = 4 * np.arange(len(corners))[:, None, None] + [[0, 1, 2], [0, 2, 3]]
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), faces.reshape(-1, 3), process=False)
    sun = Sun((math.sin(angle), 0.0, math.cos(angle)), flat(1.0 / math.cos(angle)))
    return side, Scene(
        {"leaf": RED},
        {"crowns": Asset({"leaf": mesh})},
        (Placement("crowns", "crown", np.eye(4)),),
        Lighting(flat(0.0), sun),
    )


def shares(side, scene):
    """Shares of the sunlight that are absorbed, reflected and transmitted."""
    activate(choose_variant())
    loaded = load_scene(scene, merge(scene))
    sun, grid = scene.lighting.sun, (np.arange(120) + 0.5) / 120 * side
    places = np.stack([*(each.ravel() for each in np.meshgrid(grid, grid)), np.zeros(120**2)], -1)
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
    film = {"type": "specfilm", "width": 64, "height": 64, "rfilter": {"type": "box"}, "red": band}
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("area_index", "published"),
    [(1.5, (0.2814, 0.0092, 0.7094)), (2.5, (0.4685, 0.0145, 0.5170))],
)
def test_an_open_forest_absorbs_reflects_and_transmits_its_published_shares(area_index, published):
    cover = area_index / CROWN_AREA_INDEX
    forests = [forest(cover, np.random.default_rng(seed)) for seed in range(1, PLACINGS + 1)]
    found = np.mean([shares(*each) for each in forests], axis=0)
    # Required: 2 %. From one placing of spheres to the next, shares differ by 0.5, 1 and 0.4 % (σ).
    assert found == pytest.approx(published, rel=0.02)
