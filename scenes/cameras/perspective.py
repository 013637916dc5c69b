"""Pinhole camera."""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.scenes.cameras.base import SINGULAR_RAD, LensCamera, Pixels


class PerspectiveCamera(LensCamera, frozen=True):
    """Pinhole camera with square pixels and the principal point at the image center."""

    kind: Literal["perspective"] = "perspective"
    width: Pixels = 120
    """Columns (px)."""
    height: Pixels = 120
    """Rows (px)."""
    fov_deg: Annotated[float, Field(ge=1e-3, lt=180)] = 75.0
    """Horizontal field of view (degrees)."""

    def __str__(self) -> str:
        """Description of the camera in a sentence."""
        return "camera"

    @property
    def has_image_plane(self) -> bool:
        """True: depth is measured along the optical axis."""
        return True

    @property
    def focal_length_px(self) -> float:
        """Focal length in pixels: columns per radian at the image center."""
        return self.width / (2 * math.tan(math.radians(self.fov_deg) / 2))

    @property
    def view_rad(self) -> float:
        """Horizontal field of view (rad)."""
        return math.radians(self.fov_deg)

    @property
    def steepest_tangent(self) -> float:
        """Largest |tan(elevation)| in the image of a level camera."""
        return self.height / (2 * self.focal_length_px)

    @property
    def intrinsics(self) -> Floats:
        """Matrix K (3, 3) from camera coordinates to homogeneous image coordinates, in px."""
        f = self.focal_length_px
        return np.array([[f, 0, self.width / 2], [0, f, self.height / 2], [0, 0, 1]])

    def toward(self, image: Floats) -> Floats:
        """Unit vectors (..., 3), in camera axes, through image coordinates (..., 2) in px."""
        offset = image - [self.width / 2, self.height / 2]
        ahead = np.full((*offset.shape[:-1], 1), self.focal_length_px)
        rays = np.concatenate([offset, ahead], axis=-1)
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))

    def project(self, points: Floats) -> Floats:
        """Image coordinates (..., 2) in px of points (..., 3) in camera axes.

        Only directions count, so a point at infinity is given as its direction. NaN for points that
        are not in front of the camera, or within 1e-5 rad of its image plane.
        """
        nearest = SINGULAR_RAD * np.linalg.norm(points, axis=-1, keepdims=True)
        z = np.where(points[..., 2:] > nearest, points[..., 2:], np.nan)
        return points[..., :2] / z * self.focal_length_px + [self.width / 2, self.height / 2]
