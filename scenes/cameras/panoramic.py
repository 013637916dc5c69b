"""Panoramic cameras: columns equidistant in azimuth (0 along +z, growing toward +x).

Rows are equidistant in elevation, or in its tangent on a cylinder. At elevation e a column is only
cos(e) times as wide as at the horizon: horizontal motion in px and its errors grow by 1/cos(e).
"""

import math
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.scenes.cameras.base import SINGULAR_RAD, Camera, Pixels


class PanoramicCamera(Camera, frozen=True):
    """Base of the two panoramic cameras, which differ in the spacing of rows."""

    width: Pixels = 720
    """Columns (px)."""
    height: Pixels = 360
    """Rows (px)."""
    fov_deg: Annotated[float, Field(ge=1e-3, le=360)] = 360.0
    """Horizontal field of view (degrees of azimuth); at 360 the image wraps around."""
    is_cylinder: ClassVar[bool]
    """True if rows are equidistant in the tangent of elevation instead of elevation."""
    lower_deg: float
    upper_deg: float

    @model_validator(mode="after")
    def _field_is_upright(self) -> "PanoramicCamera":
        if self.lower_deg >= self.upper_deg:
            raise ValueError(
                f"lower_deg {self.lower_deg:g} is not below upper_deg {self.upper_deg:g}: give the "
                "lower elevation first"
            )
        return self

    @property
    def wraps(self) -> bool:
        """True if the left and right edge of the image coincide."""
        return self.fov_deg == 360

    @property
    def focal_length_px(self) -> float:
        """Focal length in pixels: columns per radian of azimuth."""
        return self.width / math.radians(self.fov_deg)

    @property
    def view_rad(self) -> float:
        """Horizontal field of view (rad of azimuth)."""
        return math.radians(self.fov_deg)

    @property
    def steepest_tangent(self) -> float:
        """Largest |tan(elevation)| in the image of a level camera."""
        return max(abs(math.tan(math.radians(end))) for end in (self.lower_deg, self.upper_deg))

    @property
    def heights(self) -> tuple[float, float]:
        """Height on the film, in focal lengths, of the image's lower and upper edge."""
        lower, upper = math.radians(self.lower_deg), math.radians(self.upper_deg)
        return (math.tan(lower), math.tan(upper)) if self.is_cylinder else (lower, upper)

    def toward(self, image: Floats) -> Floats:
        """Unit vectors (..., 3), in camera axes, through image coordinates (..., 2) in px."""
        x, y = np.moveaxis(image, -1, 0)
        azimuth = (x / self.width - 0.5) * math.radians(self.fov_deg)
        lower, upper = self.heights
        height = upper - y / self.height * (upper - lower)
        if self.is_cylinder:
            length = np.hypot(1, height)
            radius, rise = 1 / length, height / length
        else:
            radius, rise = np.cos(height), np.sin(height)
        return np.stack([radius * np.sin(azimuth), -rise, radius * np.cos(azimuth)], axis=-1)

    def project(self, points: Floats) -> Floats:
        """Image coordinates (..., 2) in px of points (..., 3) in camera axes.

        Only directions count, so a point at infinity is given as its direction. NaN for points
        within 1e-5 rad of the vertical through the camera, which have no azimuth.
        """
        right, down, forward = np.moveaxis(points, -1, 0)
        radius = np.hypot(right, forward)
        radius = np.where(radius > SINGULAR_RAD * np.abs(down), radius, np.nan)
        lower, upper = self.heights
        x = np.arctan2(right, forward) / math.radians(self.fov_deg) + 0.5
        height = -down / radius if self.is_cylinder else np.arctan2(-down, radius)
        y = (upper - height) / (upper - lower)
        return np.stack([np.where(np.isnan(y), np.nan, x) * self.width, y * self.height], axis=-1)


class EquirectangularCamera(PanoramicCamera, frozen=True):
    """Panorama whose rows are equidistant in elevation, 2:1 for the whole sphere."""

    kind: Literal["equirectangular"] = "equirectangular"
    is_cylinder = False

    lower_deg: Annotated[float, Field(ge=-90, le=90)] = -90.0
    """Elevation at the lower edge of the image (degrees)."""
    upper_deg: Annotated[float, Field(ge=-90, le=90)] = 90.0
    """Elevation at the upper edge of the image (degrees)."""


class CylindricalCamera(PanoramicCamera, frozen=True):
    """Panorama on a cylinder: verticals stay straight, rows are equidistant in tan(elevation).

    At the default size and field of view pixels are square within half a percent.
    """

    kind: Literal["cylindrical"] = "cylindrical"
    is_cylinder = True

    height: Pixels = 230
    """Rows (px)."""
    lower_deg: Annotated[float, Field(gt=-90, lt=90)] = -45.0
    """Elevation at the lower edge of the image (degrees)."""
    upper_deg: Annotated[float, Field(gt=-90, lt=90)] = 45.0
    """Elevation at the upper edge of the image (degrees)."""
