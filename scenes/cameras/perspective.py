"""Any camera: the pinhole, and the choice between it and the panoramas.

Camera axes are those of computer vision: +x right, +y down, +z forward. Continuous image
coordinates put the center of the pixel in column i and row j at (i + 0.5, j + 0.5).
"""

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, Field

from megalopta.scenes.cameras.panoramic import CylindricalCamera, EquirectangularCamera
from megalopta.scenes.cameras.pixels import MOST_PX, SINGULAR_RAD, Float64, pixel_centers


class PerspectiveCamera(
    BaseModel, frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
):
    """Pinhole camera with square pixels and the principal point at the image center."""

    kind: Literal["perspective"] = "perspective"
    """Which camera this is: perspective, equirectangular or cylindrical."""

    width: Annotated[int, Field(ge=1, le=MOST_PX)] = 120
    """Columns (px)."""

    height: Annotated[int, Field(ge=1, le=MOST_PX)] = 120
    """Rows (px)."""

    fov_deg: Annotated[float, Field(ge=1e-3, lt=180)] = 75.0
    """Horizontal field of view (degrees)."""

    @property
    def wraps(self) -> bool:
        """Whether the left and right edge of the image are the same place."""
        return False

    @property
    def depth_meaning(self) -> str:
        """Along what depth is measured."""
        return "along the optical axis"

    @property
    def focal_length_px(self) -> float:
        """Focal length in pixels: columns per radian at the image center."""
        return self.width / (2 * math.tan(math.radians(self.fov_deg) / 2))

    @property
    def steepest_tangent(self) -> float:
        """Largest |tan(elevation)| that the camera sees when it is level."""
        return self.height / (2 * self.focal_length_px)

    @property
    def intrinsics(self) -> Float64:
        """Matrix K (3, 3) from camera coordinates to homogeneous image coordinates, in px."""
        f = self.focal_length_px
        return np.array([[f, 0, self.width / 2], [0, f, self.height / 2], [0, 0, 1]])

    def pixel_centers(self) -> Float64:
        """Image coordinates (H, W, 2) of all pixel centers, (x, y) in px."""
        return pixel_centers(self.width, self.height)

    def directions(self) -> Float64:
        """Unit vectors (H, W, 3) through the pixel centers, in camera axes."""
        offset = self.pixel_centers() - [self.width / 2, self.height / 2]
        rays = np.dstack([offset, np.full(offset.shape[:2], self.focal_length_px)])
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))

    def project(self, points: Float64) -> Float64:
        """Image coordinates (..., 2) in px of points (..., 3) in camera axes.

        Only directions count, so a point at infinity is given as its direction. NaN for points that
        are not in front of the camera, or within 1e-5 rad of its image plane.
        """
        nearest = SINGULAR_RAD * np.linalg.norm(points, axis=-1, keepdims=True)
        z = np.where(points[..., 2:] > nearest, points[..., 2:], np.nan)
        return points[..., :2] / z * self.focal_length_px + [self.width / 2, self.height / 2]

    def displacement(self, points: Float64) -> Float64:
        """Way in px (H, W, 2) from each pixel center to where its point (H, W, 3) is seen."""
        return self.project(points) - self.pixel_centers()

    def depth(self, distance: Float64) -> Float64:
        """Depth (H, W) along the optical axis, m, of the distances (H, W) that pixels see."""
        return distance * self.directions()[..., 2]


def _perspective_unless_said(values: Any) -> Any:
    return {"kind": "perspective", **values} if isinstance(values, dict) else values


Camera = Annotated[
    PerspectiveCamera | EquirectangularCamera | CylindricalCamera,
    Field(discriminator="kind"),
    BeforeValidator(_perspective_unless_said),
]
"""Any camera; `kind` tells which, and without it the camera is perspective."""
