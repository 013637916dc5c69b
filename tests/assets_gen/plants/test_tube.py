import numpy as np
import pytest

from megalopta.assets_gen.plants.tube import rotation_minimizing_frames, sweep

from ..conftest import welded

TILE_M = (0.8, 1.6)


def helix(turns=2.0, count=200):
    t = np.linspace(0, 2 * np.pi * turns, count)
    return np.stack([np.cos(t), np.sin(t), 0.3 * t], axis=-1)


def tube(axis, radius, sides=12, whole_tiles=False):
    profile = np.full((len(axis) - 1, sides), radius)
    return sweep(axis, profile, TILE_M, np.zeros(2), whole_tiles)


def test_frames_on_a_helix_turn_back_by_its_torsion():
    # A helix of radius 1 and pitch 2πb has torsion b / (1 + b²); relative to the curve's principal normal a
    # rotation-minimizing frame turns by minus the integral of the torsion over arc length.
    axis, b = helix(count=4000), 0.3
    tangents, normals, _ = rotation_minimizing_frames(axis)
    principal = -axis * (1, 1, 0)
    across = np.cross(tangents, principal)
    angle = np.unwrap(np.arctan2((normals * across).sum(1), (normals * principal).sum(1)))
    arc = 4 * np.pi * np.sqrt(1 + b**2)
    # second-order method: error falls with the square of the 4000 steps
    assert angle[-2] - angle[1] == pytest.approx(-arc * b / (1 + b**2), rel=2e-3)


@pytest.mark.parametrize("sides", [3, 4, 7, 12])
@pytest.mark.parametrize("axis", [helix(0.4, 9), np.array([[0, 0, 0], [0.2, 0, 1.0]])])
def test_tubes_are_closed_with_their_outside_out(axis, sides):
    mesh = welded(tube(axis, 0.05, sides))
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume > 0


def test_volume_is_that_of_a_prism_and_a_pyramid():
    radius, sides = 0.3, 12
    volume = welded(tube(np.outer([0, 1, 2, 3.5], [0, 0, 1.0]), radius, sides)).volume
    section = sides / 2 * radius**2 * np.sin(2 * np.pi / sides)
    assert volume == pytest.approx(section * (2 + 1.5 / 3), rel=1e-12)


def test_texture_runs_along_the_tube_at_constant_scale():
    axis = helix(0.5, 30)
    surface = tube(axis, 0.1, whole_tiles=False)
    length = np.linalg.norm(np.diff(axis, axis=0), axis=1).sum()
    assert np.ptp(surface.uv[:, 1]) * TILE_M[1] == pytest.approx(length, rel=1e-12)
    assert np.ptp(surface.uv[:, 0]) * TILE_M[0] == pytest.approx(2 * np.pi * 0.1, rel=1e-12)
