"""Base of every camera: pixels, and the mapping between pixels and directions.

Camera axes follow computer vision: +x right, +y down, +z forward. In continuous image coordinates
the center of the pixel in column i and row j is at (i + 0.5, j + 0.5).
"""

from abc import abstractmethod
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.core.record import Record

SINGULAR_RAD = 1e-5
"""Points this close to a singularity of the projection have no image (rad)."""

Pixels = Annotated[int, Field(ge=1, le=2**15)]


class Camera(Record, frozen=True):
    """Projection and image size."""

    kind: str
    """Kind of camera."""
    width: Pixels
    """Columns (px)."""
    height: Pixels
    """Rows (px)."""

    def __str__(self) -> str:
        """Description of the camera in a sentence."""
        return f"{self.kind} camera"

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height, self.width

    @property
    def has_image_plane(self) -> bool:
        """True if depth is measured along the optical axis, False if along the ray."""
        return False

    @property
    def depth_meaning(self) -> str:
        """Direction of measured depth."""
        return "along the optical axis" if self.has_image_plane else "along the ray"

    @property
    def wraps(self) -> bool:
        """True if the left and right edge of the image coincide."""
        return False

    @property
    def intrinsics(self) -> Floats | None:
        """Matrix K (3, 3) of a pinhole; None for other cameras."""
        return None

    @property
    def lens_m(self) -> tuple[float, float] | None:
        """Radius of the lens's opening and distance in focus, m; None if all is sharp."""
        return None

    @property
    @abstractmethod
    def focal_length_px(self) -> float:
        """Focal length in pixels: columns per radian at the image center."""

    @property
    @abstractmethod
    def view_rad(self) -> float:
        """Horizontal field of view (rad)."""

    @property
    @abstractmethod
    def steepest_tangent(self) -> float:
        """Largest |tan(elevation)| in the image of a level camera."""

    @abstractmethod
    def toward(self, image: Floats) -> Floats:
        """Unit vectors (..., 3), in camera axes, through image coordinates (..., 2) in px."""

    def directions(self) -> Floats:
        """Unit vectors (H, W, 3) through the pixel centers, in camera axes."""
        return self.toward(self.pixel_centers())

    @abstractmethod
    def project(self, points: Floats) -> Floats:
        """Image coordinates (..., 2) in px of points (..., 3) in camera axes.

        Only directions count, so a point at infinity is given as its direction. NaN for points
        without an image, regardless of image size.
        """

    def pixel_centers(self) -> Floats:
        """Image coordinates (H, W, 2) of all pixel centers, (x, y) in px."""
        x, y = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        return np.stack([x, y], axis=-1)

    def finer(self, parts: int) -> Self:
        """Return the camera with each pixel divided into parts × parts."""
        return self.model_copy(update={"width": self.width * parts, "height": self.height * parts})

    def with_rows(self, rows: int) -> Self:
        """Return the camera with fewer rows, around the same direction."""
        return self.model_copy(update={"height": rows})

    def displacement(self, points: Floats, image: Floats | None = None) -> Floats:
        """Displacement in px (..., 2) from image coordinates to the images of points (..., 3).

        Image coordinates (..., 2) default to the pixel centers, for points (H, W, 3). In full
        panoramas it goes the shorter way, across the seam if necessary.
        """
        way = self.project(points) - (self.pixel_centers() if image is None else image)
        if self.wraps:
            half = self.width / 2
            way[..., 0] = (way[..., 0] + half) % self.width - half
        return way

    def depth(self, distance: Floats) -> Floats:
        """Depth (H, W), m, from the distances (H, W) along the rays."""
        return distance * self.directions()[..., 2] if self.has_image_plane else distance

    @property
    def magnification_px(self) -> Floats:
        """Pixels to the radian, or (H, W): root of the image's area over that of a flat object."""
        return np.array(self.focal_length_px)

    def blur_px(self, depth: Floats) -> NDArray[np.float32] | None:
        """Radius (H, W) of the blur of points at depths (H, W), m, px; None if all is sharp."""
        if self.lens_m is None:
            return None
        radius, focus = self.lens_m
        blur = self.magnification_px * radius * np.abs(1 / depth - 1 / focus)
        return np.asarray(blur, np.float32)


class LensCamera(Camera, frozen=True):
    """Camera that looks through a pinhole or a thin lens, onto a plane.

    Points at a depth z, focused at s, are blurred to a disc of f·(D/2)·|1/z - 1/s| px around their
    image by a pinhole, with the opening's diameter D and f pixels to the radian.
    """

    aperture_mm: Annotated[float, Field(gt=0, le=1000)] | None = Field(
        default=None, exclude_if=lambda diameter: diameter is None
    )
    """Diameter of the lens's opening (mm), its focal length over its f-number; default: a pinhole,
    to which everything is sharp."""
    focus_m: Annotated[float, Field(gt=0)] | None = Field(
        default=None, exclude_if=lambda distance: distance is None
    )
    """Distance along the optical axis that is in focus (m); needed with `aperture_mm`."""

    @model_validator(mode="after")
    def _lens_is_whole(self) -> Self:
        given, missing = ("aperture_mm", "focus_m")[:: 1 if self.aperture_mm else -1]
        if (self.aperture_mm is None) != (self.focus_m is None):
            raise ValueError(f"{given} without {missing}: give both for a lens, or none")
        return self

    @property
    def lens_m(self) -> tuple[float, float] | None:
        """Radius of the lens's opening and distance in focus, m; None if all is sharp."""
        if self.aperture_mm is None or self.focus_m is None:
            return None
        return self.aperture_mm / 2000, self.focus_m
