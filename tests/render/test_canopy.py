"""Gap fraction against the closed form, and what a forest lets through."""

import math

import numpy as np
import pytest

from megalopta.render import activate, choose_variant, gap_fraction
from megalopta.render.loading.scene import bare_mesh, gather
from megalopta.scenes import PerspectiveCamera

from .conftest import quad

CAMERA = PerspectiveCamera(width=8, height=8, fov_deg=75)
LEAF_AREA_INDEX = 0.5
WIDE_M, DISC_M = 24.0, 0.04
"""The layer's sides, and the radius of a disc; the layer is a meter thick."""


def layer_of_discs(rng):
    """Hexagons in random places that face anywhere, as one mesh."""
    angle = np.pi / 3 * np.arange(6)
    area = 1.5 * math.sqrt(3) * DISC_M**2
    count = round(LEAF_AREA_INDEX * WIDE_M**2 / area)
    middle = rng.uniform((-WIDE_M / 2, -WIDE_M / 2, 1), (WIDE_M / 2, WIDE_M / 2, 2), (count, 3))
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    around = np.cos(angle)[:, None, None] * first + np.sin(angle)[:, None, None] * second
    corners = (middle + DISC_M * around).swapaxes(0, 1)
    fan = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    faces = 6 * np.arange(count)[:, None, None] + fan
    return corners.reshape(-1, 3), faces.reshape(-1, 3)


@pytest.fixture(scope="module")
def loaded():
    activate(choose_variant())
    vertices, faces = layer_of_discs(np.random.default_rng(1))
    return gather([bare_mesh(vertices.astype(np.float32), faces.astype(np.uint32))])


@pytest.mark.slow
@pytest.mark.parametrize("zenith_deg", [0.0, 30.0, 57.0, 75.0])
def test_gaps_of_a_random_canopy_are_those_of_beer_and_lambert(loaded, zenith_deg):
    rng = np.random.default_rng(2)
    # rays at 75 degrees go 7.5 m to the side before they leave the layer, which ends 8 m away
    points = np.column_stack([rng.uniform(-4, 4, (40_000, 2)), np.zeros(40_000)])
    found = gap_fraction(loaded, points, zenith_deg, rng, azimuths=8)
    # a leaf that faces anywhere projects to half of its area on average
    expected = math.exp(-0.5 * LEAF_AREA_INDEX / math.cos(math.radians(zenith_deg)))
    # At 75 degrees discs of 40 cm² over some 200 m² scatter the gaps by 0.6 %, elsewhere by less,
    # and the rays by 0.3 %; the seeds are fixed, so nothing alarms by chance.
    assert found.value == pytest.approx(expected, rel=0.02)
    assert found.standard_error < 0.005 * expected


def test_the_share_of_blocked_rays_under_half_a_roof_is_exact():
    activate(choose_variant())
    roof = quad(np.array([[0, -99, 1], [99, -99, 1], [99, 99, 1], [0, 99, 1]]))
    loaded = gather([bare_mesh(roof.vertices.astype(np.float32), roof.faces.astype(np.uint32))])
    points = np.array([[0.001, 0, 0], [-50.0, 0, 0]])
    found = gap_fraction(loaded, points, 45.0, np.random.default_rng(0))
    # half the azimuths below the roof's edge, all of them far from it; one of 64 sectors is torn
    assert found.value == pytest.approx(0.75, abs=2 / 64)
