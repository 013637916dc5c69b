"""Fisheye camera: the distance from the image center is the angle from the axis."""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.scenes.cameras.base import SINGULAR_RAD, Camera, Pixels


class FisheyeCamera(Camera, frozen=True):
    """Equidistant projection."""

    kind: Literal["fisheye"] = "fisheye"
    """Which camera this is."""
    width: Pixels = 256
    """Columns (px)."""
    height: Pixels = 256
    """Rows (px)."""
    fov_deg: Annotated[float, Field(gt=0, le=360)] = 180.0
    """Field of view (degrees) across the width."""

    @property
    def focal_length_px(self) -> float:
        """Columns per radian."""
        return self.width / math.radians(self.fov_deg)

    @property
    def steepest_tangent(self) -> float:
        """Largest |tan(elevation)| that the camera sees when it is level."""
        steepest = self.height / 2 / self.focal_length_px
        return math.tan(steepest) if steepest < math.pi / 2 else math.inf

    def toward(self, image: Floats) -> Floats:
        """Unit vectors (..., 3), in camera axes, through image coordinates (..., 2) in px."""
        offset = (image - np.array([self.width, self.height]) / 2) / self.focal_length_px
        angle = np.hypot(*np.moveaxis(offset, -1, 0))[..., None]
        return np.concatenate([offset * np.sinc(angle / np.pi), np.cos(angle)], axis=-1)

    def project(self, points: Floats) -> Floats:
        """Image coordinates (..., 2) in px of points (..., 3) in camera axes; NaN behind."""
        right, down, forward = np.moveaxis(points, -1, 0)
        radius = np.hypot(right, down)
        angle = np.arctan2(radius, forward)
        angle = np.where(np.pi - angle > SINGULAR_RAD, angle, np.nan)
        stretch = np.where(radius > 0, angle / np.where(radius > 0, radius, 1), 1 / forward)
        offset = np.stack([right, down], axis=-1) * stretch[..., None] * self.focal_length_px
        return np.asarray(offset + np.array([self.width, self.height]) / 2)
