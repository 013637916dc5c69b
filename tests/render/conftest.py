import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from megalopta.scenes.scene import Asset, Material, Placement
from megalopta.scenes.spectrum import flat


def quad(corners: NDArray[np.float64]) -> trimesh.Trimesh:
    """Two triangles over four corners given in order."""
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


def placed(mesh: trimesh.Trimesh, name: str = "thing") -> tuple[dict, dict, tuple]:
    """Materials, assets and placements of a scene of one gray mesh."""
    return (
        {name: Material(flat(0.5))},
        {name: Asset({name: mesh})},
        (Placement(name, name, np.eye(4)),),
    )


@pytest.fixture
def ground() -> trimesh.Trimesh:
    """The plane z = 0, 2 km wide."""
    return quad(1000.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]))
