"""The pinhole camera.

Camera axes are those of computer vision: +x right, +y down, +z forward. Continuous image
coordinates put the center of the pixel in column i and row j at (i + 0.5, j + 0.5).
"""

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field


class PerspectiveCamera(
    BaseModel, frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
):
    """Pinhole camera with square pixels and the principal point at the image center."""

    width: Annotated[int, Field(ge=1)] = 120
    """Columns (px)."""

    height: Annotated[int, Field(ge=1)] = 120
    """Rows (px)."""

    fov_deg: Annotated[float, Field(gt=0, lt=180)] = 75.0
    """Horizontal field of view (degrees)."""

    @property
    def focal_length_px(self) -> float:
        """Focal length in pixels."""
        return self.width / (2 * math.tan(math.radians(self.fov_deg) / 2))

    @property
    def intrinsics(self) -> NDArray[np.float64]:
        """Matrix K (3, 3) from camera coordinates to homogeneous image coordinates, in px."""
        f = self.focal_length_px
        return np.array([[f, 0, self.width / 2], [0, f, self.height / 2], [0, 0, 1]])

    def pixel_centers(self) -> NDArray[np.float64]:
        """Image coordinates (H, W, 2) of all pixel centers, (x, y) in px."""
        x, y = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        return np.stack([x, y], axis=-1)

    def directions(self) -> NDArray[np.float64]:
        """Unit vectors (H, W, 3) through the pixel centers, in camera axes."""
        offset = self.pixel_centers() - [self.width / 2, self.height / 2]
        rays = np.dstack([offset, np.full(offset.shape[:2], self.focal_length_px)])
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Image coordinates (..., 2) in px of points (..., 3) in camera axes.

        Only directions count, so a point at infinity is given as its direction. NaN for points that
        are not in front of the camera, or within 1e-5 rad of its image plane.
        """
        nearest = 1e-5 * np.linalg.norm(points, axis=-1, keepdims=True)
        z = np.where(points[..., 2:] > nearest, points[..., 2:], np.nan)
        return points[..., :2] / z * self.focal_length_px + [self.width / 2, self.height / 2]

    def displacement(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Way in px (H, W, 2) from each pixel center to where its point (H, W, 3) is seen."""
        return self.project(points) - self.pixel_centers()

    def depth(self, distance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Depth (H, W) along the optical axis, m, of the distances (H, W) that pixels see."""
        return distance * self.directions()[..., 2]
