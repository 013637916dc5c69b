import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from megalopta.scenes.material import Emission, Material
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat


def quad(corners: NDArray[np.float64]) -> trimesh.Trimesh:
    """Two triangles over four corners given in order."""
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


def sphere_cap(center, radius, toward):
    """The side of a sphere that faces a point, in triangles so fine that facets do not matter.

    With steps of 0.003 rad a facet lies at most radius · 1.2e-6 below the sphere.
    """
    angles = np.arange(-0.75, 0.7501, 0.003)
    u, v = np.meshgrid(angles, angles)
    local = np.stack([np.tan(u), np.tan(v), np.ones_like(u)], axis=-1)
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    axis = (toward - center) / np.linalg.norm(toward - center)
    side = np.cross(axis, [0, 0, 1.0])
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(axis, side), axis])
    n = len(angles)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate(
        [np.column_stack([a, a + 1, a + n]), np.column_stack([a + 1, a + n + 1, a + n])]
    )
    vertices = center + radius * local.reshape(-1, 3) @ frame
    return trimesh.Trimesh(vertices, faces, process=False)


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


def glowing_room() -> Scene:
    """Walls all around the origin that glow with noise some degrees wide, without any symmetry."""
    room = trimesh.creation.box((9, 7, 6))
    room.invert()  # surfaces glow to the outside of their mesh
    corners = room.vertices[room.faces].reshape(-1, 3)  # a texture coordinate per face and corner
    axis = np.abs(np.repeat(room.face_normals, 3, axis=0)).argmax(axis=1)
    rows = np.arange(len(corners))
    uv = np.column_stack([corners[rows, (axis + 1) % 3], corners[rows, (axis + 2) % 3]])
    walls = trimesh.Trimesh(corners, rows.reshape(-1, 3), process=False)
    walls.visual = trimesh.visual.TextureVisuals(uv=uv / 9 + np.sign(corners)[:, :1] / 7)
    noise = gaussian_filter(np.random.default_rng(2).normal(size=(512, 512)), 14, mode="wrap")
    pattern = np.maximum(1 + noise / (4 * noise.std()), 0).astype(np.float32)
    return Scene(
        {"glow": Material(flat(0.0), None, Emission(1e-6, pattern))},
        {"walls": Asset({"glow": walls})},
        (Placement("walls", "walls", np.eye(4)),),
    )
