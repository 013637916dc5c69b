import numpy as np
import pytest
import trimesh

from megalopta.scenes.material import Material
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat

BOX = trimesh.creation.box((1, 1, 1))


def test_triangles_are_counted_as_placed():
    placements = tuple(Placement("box", "box", np.eye(4)) for _ in range(3))
    scene = Scene({"m": Material(flat(0.5))}, {"box": Asset({"m": BOX})}, placements)
    assert scene.triangle_count == 3 * 12


def test_dangling_names_are_refused():
    with pytest.raises(ValueError, match="no such asset"):
        Scene({}, {}, (Placement("box", "box", np.eye(4)),))
    with pytest.raises(ValueError, match=r"no material \['m'\]"):
        Scene({}, {"box": Asset({"m": BOX})}, ())
