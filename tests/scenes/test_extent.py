"""Extent of what a camera looks at, whatever else a file holds."""

import numpy as np
import pytest
import trimesh

from megalopta.scenes.material import Emission, Material
from megalopta.scenes.motion import Drift, RigidMotion
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat
from megalopta.scenes.trajectories.orbit import bounds_of

BOX = trimesh.creation.box((1, 2, 3))
STRAY = trimesh.Trimesh([*BOX.vertices, [9e5, 0, 0]], BOX.faces, process=False)
FLAT = trimesh.Trimesh(
    [*BOX.vertices, [9e5, 0, 0], [9e5, 0, 1]], [*BOX.faces, [8, 9, 9]], process=False
)
DOME = trimesh.creation.icosphere(2, 500.0)
GROUND = trimesh.creation.box((2000, 2000, 0.1))
ROOM = trimesh.creation.box((6, 6, 6))


def scene(*meshes, motion=None, lamp=None):
    """Objects of a material each; the last is perhaps a lamp."""
    materials = {f"{n}": Material(flat(0.5)) for n in range(len(meshes))}
    if lamp is not None:
        materials["lamp"] = Material(flat(0.0), emission=Emission(1.0))
        meshes += (lamp,)
    names = list(materials)
    assets = {name: Asset({name: mesh}) for name, mesh in zip(names, meshes, strict=True)}
    placements = tuple(Placement(name, "thing", np.eye(4), motion) for name in names)
    return Scene(materials, assets, placements)


@pytest.mark.parametrize(
    ("made", "size"),
    [
        (scene(BOX), (1, 2, 3)),
        (scene(STRAY), (1, 2, 3)),
        (scene(FLAT), (1, 2, 3)),
        (scene(BOX, lamp=trimesh.creation.icosphere(1, 90.0)), (1, 2, 3)),
        (scene(lamp=BOX), (1, 2, 3)),
        (scene(BOX, DOME), (1, 2, 3)),
        (scene(GROUND, BOX, DOME), (1, 2, 3)),
        (scene(GROUND, BOX, motion=RigidMotion((0, 0, 0), Drift())), (1, 2, 3)),
        (scene(BOX, ROOM), (6, 6, 6)),  # no ground or dome
    ],
)
def test_bounds_are_those_of_what_a_camera_looks_at(made, size):
    bounds = bounds_of(made)
    np.testing.assert_allclose(bounds[1] - bounds[0], size, atol=1e-9)
    np.testing.assert_allclose(bounds.mean(axis=0), 0, atol=1e-9)
