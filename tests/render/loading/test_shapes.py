"""The mesh of a hit by its shape, against Embree's own number of it."""

import numpy as np
import pytest
import trimesh

from megalopta.render import activate, choose_variant, mi
from megalopta.render.loading.meshes import merge
from megalopta.render.loading.scene import MeshIndex, load_scene
from megalopta.scenes.material import Material
from megalopta.scenes.scene import (
    Asset,
    Lighting,
    Placement,
    Scene,
)
from megalopta.scenes.spectra.spectrum import flat


@pytest.mark.skipif(choose_variant().name.startswith("scalar"), reason="of vectorized variants")
def test_meshes_are_told_apart_by_their_shape_in_every_scene_of_a_process():
    activate(choose_variant())
    names = [f"box{index}" for index in range(5)]
    boxes = [trimesh.creation.box((1, 1, 1)) for _ in names]
    for index, box in enumerate(boxes):
        box.apply_translation([3 * index, 0, 0])
    scene = Scene(
        {name: Material(flat(0.5)) for name in names},
        {name: Asset({name: box}) for name, box in zip(names, boxes, strict=True)},
        tuple(Placement(name, name, np.eye(4)) for name in names),
        Lighting(flat(1e-9)),
    )
    # The second scene's shapes have other numbers in the registry.
    for loaded in [load_scene(scene, merge(scene)) for _ in range(2)]:
        x = np.array([12.0, 0.0, 9.0, 3.0, 6.0, 99.0])
        origin = mi.Point3f(np.stack([x, np.zeros(6), np.full(6, 5.0)]))
        hit = loaded.ray_intersect_preliminary(mi.Ray3f(origin, mi.Vector3f(0, 0, -1)))
        found = np.array(MeshIndex(loaded).of(hit))
        assert found.tolist() == [4, 0, 3, 1, 2, 0]
        assert np.array(hit.is_valid()).tolist() == 5 * [True] + [False]
