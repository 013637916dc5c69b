"""Cameras and ideal shapes from the numbers of a path, in float64: no poses, meshes or renderer."""

import numpy as np
from scipy.spatial.transform import Rotation

from megalopta.scenes import Trajectory

BOTH = Trajectory(
    frames=3,
    position_m=(0.5, -1.0, 2.0),
    look_at_m=(8.0, 2.0, 0.0),
    rotation_deg_s=25.0,
    velocity_m_s=(2.0, -1.0, 0.7),
)
"""A path that turns and moves."""


def eyes(path, times):
    """Camera position (n, 3), in steps of float32 as documented, and axes (n, 3, 3) as rows."""
    view = np.subtract(path.look_at_m, path.position_m)
    turn = Rotation.from_euler("z", path.rotation_deg_s * np.array(times)[:, None], degrees=True)
    forward = turn.apply(np.tile(view / np.linalg.norm(view), (len(times), 1)))
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    position = np.array(path.position_m) + np.outer(times, path.velocity_m_s)
    local = (position - path.origin_m).astype(np.float32)
    return local + path.origin_m, np.stack([right, np.cross(forward, right), forward], axis=1)


def eye(path, frame):
    """Camera position and its axes right, down, forward in a frame."""
    return (each[0] for each in eyes(path, [frame / path.frame_rate_hz]))


class Pinhole:
    """Rays through the centers of pixels, and where points are seen, in frames of a path."""

    def __init__(self, camera, path):
        self.path, self.size = path, np.array([camera.width, camera.height])
        self.focal = camera.width / 2 / np.tan(np.radians(camera.fov_deg) / 2)
        self.centers = np.dstack(np.meshgrid(*(np.arange(n) + 0.5 for n in self.size)))

    def rays(self, frame):
        """Position and directions (H, W, 3) of unit depth."""
        position, axes = eye(self.path, frame)
        plane = (self.centers - self.size / 2) / self.focal
        return position, np.dstack([plane, np.ones(plane.shape[:2])]) @ axes

    def displacement(self, frame, points):
        """From the pixels' centers to where points (H, W, 3) are seen in a frame, in px."""
        position, axes = eye(self.path, frame)
        seen = (points - position) @ axes.T
        return seen[..., :2] / seen[..., 2:] * self.focal + self.size / 2 - self.centers

    def flow(self, frame, other, hit):
        """Flow (H, W, 2) between frames of the surface that rays hit."""
        position, directions = self.rays(frame)
        points = position + hit(position, directions)[..., None] * directions
        return self.displacement(other, points)


def plane_hit(position, directions, height=0.0):
    """Distance to a level plane along directions, in units of them; NaN for none."""
    with np.errstate(divide="ignore"):
        distance = (height - position[2]) / directions[..., 2]
    return np.where((distance > 0) & np.isfinite(distance), distance, np.nan)


def sphere_hit(center, radius):
    def distance(position, directions):
        a = (directions**2).sum(-1)
        b = directions @ (position - center)
        c = ((position - center) ** 2).sum() - radius**2
        with np.errstate(invalid="ignore"):
            return (-b - np.sqrt(b**2 - a * c)) / a

    return distance


def box_hit(half, center, turn, position, directions):
    """First hit on a box by the slab method, in the box's axes; infinite for none."""
    start = turn.inv().apply(position - center)
    along = turn.inv().apply(directions.reshape(-1, 3)).reshape(directions.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.stack([-half - start, half - start])
        sides = sides.reshape(2, *[1] * (directions.ndim - start.ndim), *start.shape) / along
    near, far = sides.min(axis=0).max(axis=-1), sides.max(axis=0).min(axis=-1)
    return np.where((near <= far) & (near > 0), near, np.inf)


def triangle_hit(start, ways, triangles):
    """Distances (n,) along ways (n, 3) to triangles, the triangles (n,), and weights (n, 2).

    Möller and Trumbore (1997), in float64, without any tree; infinite for none, and then -1.
    """
    a, u, v = triangles[:, 0], *(triangles[:, n] - triangles[:, 0] for n in (1, 2))
    q = np.cross(start - a, u)
    found = []
    for way in ways:
        p = np.cross(way, v)
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.einsum("ij,ij->i", p, u)
            first = np.einsum("ij,ij->i", p, start - a) / size
            second = q @ way / size
            along = np.einsum("ij,ij->i", q, v) / size
            hit = (first >= 0) & (second >= 0) & (first + second <= 1) & (along > 1e-9)
        best = np.where(hit, along, np.inf).argmin()
        met = along[best], best, first[best], second[best]
        found.append(met if hit.any() else (np.inf, -1, 0.0, 0.0))
    distance, best, first, second = np.array(found).T
    return distance, best.astype(int), np.stack([first, second], axis=1)
