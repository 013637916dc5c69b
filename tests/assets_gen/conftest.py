import numpy as np
import trimesh


def welded(surface) -> trimesh.Trimesh:
    """A surface's mesh with vertices of equal position merged, whatever their uv and normals."""
    corners, index = np.unique(surface.vertices, axis=0, return_inverse=True)
    return trimesh.Trimesh(corners, index.reshape(-1)[surface.faces], process=False)


def seam_contrast(image: np.ndarray, axis: int) -> float:
    """Mean step across the image's seam over the largest mean step between rows inside it."""
    rows = np.moveaxis(image.astype(float), axis, 0)
    inside = np.abs(np.diff(rows, axis=0)).mean(axis=1).max()
    return float(np.abs(rows[0] - rows[-1]).mean() / inside)
