import numpy as np
import trimesh


def welded(surface) -> trimesh.Trimesh:
    """A surface's mesh with vertices of equal position merged, whatever their uv and normals."""
    corners, index = np.unique(surface.vertices, axis=0, return_inverse=True)
    return trimesh.Trimesh(corners, index.reshape(-1)[surface.faces], process=False)
