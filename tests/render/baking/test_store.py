"""Light that is kept is found by all that it depends on."""

from dataclasses import replace

import numpy as np
import pytest

from megalopta.render import RenderSettings
from megalopta.render.baking.light import key_of
from megalopta.render.loading.meshes import merge
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.scene import (
    Asset,
    Lighting,
    Placement,
    Scene,
)
from megalopta.scenes.spectra.spectrum import flat
from megalopta.scenes.trajectories.steady import Trajectory

from ..conftest import quad

TEXTURE = Texture(np.zeros((2, 2), np.float32), flat(0.3), flat(0.2))
LEAF = Material(flat(0.4), TEXTURE, None, flat(0.1))


def key(material):
    leaf = quad(np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]))
    scene = Scene(
        {"leaf": material},
        {"leaf": Asset({"leaf": leaf})},
        (Placement("leaf", "leaf", np.eye(4)),),
        Lighting(flat(1e-9)),
    )
    bare = Scene({"leaf": Material(flat(0.4))}, scene.assets, scene.placements, scene.lighting)
    camera = PerspectiveCamera(width=4, height=4)
    poses = Trajectory(frames=2, position_m=(0, 0, 2), look_at_m=(0, 0, 0), up=(1, 0, 0)).poses()
    return key_of(scene, merge(bare), RenderSettings(), camera, poses, 0)


@pytest.mark.parametrize(
    "other",
    [
        replace(LEAF, reflectance=flat(0.41)),
        replace(LEAF, transmittance=flat(0.11)),
        replace(LEAF, transmittance=None),
        replace(LEAF, texture=replace(TEXTURE, transmittance=flat(0.21))),
        replace(LEAF, texture=replace(TEXTURE, reflectance=flat(0.31))),
        replace(LEAF, texture=None),
    ],
)
def test_light_of_another_surface_is_not_taken_for_its(other):
    assert key(LEAF) == key(replace(LEAF)) != key(other)
