"""The mesh of a hit by its shape, against Embree's own number of it."""

import numpy as np
import trimesh

from megalopta.render import activate, choose_variant, mi
from megalopta.render.loading.meshes import merge
from megalopta.render.loading.scene import load_scene
from megalopta.render.loading.shapes import MeshIndex
from megalopta.scenes.scene import Lighting
from megalopta.scenes.spectra.spectrum import flat

from ..conftest import scene_of, vectorized


@vectorized
def test_meshes_are_told_apart_by_their_shape_in_every_scene_of_a_process():
    activate(choose_variant())
    boxes = [trimesh.creation.box((1, 1, 1)) for _ in range(5)]
    for index, box in enumerate(boxes):
        box.apply_translation([3 * index, 0, 0])
    scene = scene_of(Lighting(flat(1e-9)), *boxes)

    # The second scene's shapes have other numbers in the registry.
    for loaded in [load_scene(scene, merge(scene)) for _ in range(2)]:
        x = np.array([12.0, 0.0, 9.0, 3.0, 6.0, 99.0])
        origin = mi.Point3f(np.stack([x, np.zeros(6), np.full(6, 5.0)]))
        hit = loaded.ray_intersect_preliminary(mi.Ray3f(origin, mi.Vector3f(0, 0, -1)))
        found = np.array(MeshIndex(loaded).of(hit))
        assert found.tolist() == [4, 0, 3, 1, 2, 0]
        assert np.array(hit.is_valid()).tolist() == 5 * [True] + [False]
