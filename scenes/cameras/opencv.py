"""Calibrated camera with OpenCV's parameters: any principal point, and distortion by the lens.

A point (x, y, z) is first projected to a plane: to (x/z, y/z), or for a fisheye at its angle θ from
the optical axis, to θ·(x, y)/√(x² + y²). The lens moves a point (a, b) of the plane, with
s = a² + b², to

    a·g(s) + 2·p1·a·b + p2·(s + 2a²)
    b·g(s) + p1·(s + 2b²) + 2·p2·a·b

g is (1 + k1·s + k2·s² + k3·s³) / (1 + k4·s + k5·s² + k6·s³), and 1 + k1·s + k2·s² + k3·s³ + k4·s⁴
for a fisheye, which has no p. Sources: OpenCV, "Camera Calibration and 3D Reconstruction" (Brown,
Photogrammetric Engineering 37, 1971), and its fisheye model (Kannala and Brandt, IEEE TPAMI 28,
2006).

Parameters are OpenCV's; image coordinates in this program are greater by half a pixel. Points from
where such polynomials turn back on have no image.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.polynomial import Polynomial
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.scenes.cameras.base import SINGULAR_RAD, LensCamera

_ACCURACY, _MOST_STEPS = 1e-10, 30
"""Largest of Newton's last steps, in focal lengths, and their number."""
_TABLE = 1025
"""Radii among which the first guess of an undistorted point is found."""
_CHECKED = 65
"""Points along each side of the image, and on lines between, at which the lens is inverted."""


class OpenCVCamera(LensCamera, frozen=True):
    """Calibrated camera: OpenCV's matrix, and the distortion of its lens or fisheye."""

    kind: Literal["opencv"] = "opencv"
    fx_px: Annotated[float, Field(gt=0)]
    """Focal length along rows (px)."""
    fy_px: Annotated[float, Field(gt=0)]
    """Focal length along columns (px)."""
    cx_px: float
    """Column of the principal point (px); 0 is the center of the first pixel, as in OpenCV."""
    cy_px: float
    """Row of the principal point (px); 0 is the center of the first pixel, as in OpenCV."""
    distortion: tuple[float, ...] = ()
    """k1, k2, p1, p2, k3, and for OpenCV's rational model k4, k5, k6; default: none."""
    fisheye: tuple[float, ...] = ()
    """k1, k2, k3, k4 of OpenCV's fisheye model instead; default: no fisheye."""

    @model_validator(mode="after")
    def _has_one_lens(self) -> "OpenCVCamera":
        if self.distortion and self.fisheye:
            raise ValueError("distortion and fisheye are both given: omit one of them")
        if len(self.distortion) not in (0, 5, 8):
            raise ValueError(f"distortion has {len(self.distortion)} coefficients: give 5 or 8")
        if len(self.fisheye) not in (0, 4):
            raise ValueError(f"fisheye has {len(self.fisheye)} coefficients: give 4")
        if self.fisheye and self.aperture_mm:
            raise ValueError("aperture_mm: a fisheye has no plane in focus; omit it and focus_m")
        return self

    @model_validator(mode="after")
    def _lens_is_invertible(self) -> "OpenCVCamera":
        sides = (np.linspace(0, size, _CHECKED) for size in (self.width, self.height))
        image = np.dstack(np.meshgrid(*sides)).reshape(-1, 2)
        lost = np.isnan(self.toward(image)).any(axis=-1)
        if lost.any():
            name = "fisheye" if self.fisheye else "distortion"
            x, y = image[lost][0] - 0.5
            raise ValueError(
                f"{name} {[*getattr(self, name)]} has no inverse at ({x:g}, {y:g}) px, inside the "
                "image: give coefficients that rise up to the corners, or a smaller image"
            )
        return self

    @property
    def has_image_plane(self) -> bool:
        """True if depth is measured along the optical axis, False of a fisheye."""
        return not self.fisheye

    @property
    def intrinsics(self) -> Floats | None:
        """Matrix K (3, 3), px, with pixel centers at half integers; None if the lens distorts."""
        if self.fisheye or any(self.distortion):
            return None
        (fx, fy), (cx, cy) = self._focal, self._principal
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])

    @property
    def focal_length_px(self) -> float:
        """Focal length in pixels: columns per radian at the principal point."""
        return self.fx_px

    @property
    def magnification_px(self) -> Floats:
        """Pixels (H, W) to the radian: root of the image's area over that of a flat object."""
        plane = self._lens.undistorted((self.pixel_centers() - self._principal) / self._focal)
        return np.asarray(np.sqrt(self._focal.prod() * self._lens.growth(plane)))

    @property
    def view_rad(self) -> float:
        """Horizontal field of view, in azimuth along the middle row (rad)."""
        ends = np.array([[0, self.height / 2], [self.width, self.height / 2]])
        left, right = (math.atan2(x, z) for x, _, z in self.toward(ends))
        return right - left

    @property
    def steepest_tangent(self) -> float:
        """Largest |tan(elevation)| in the image of a level camera; infinite around a pole."""
        poles = self.project(np.array([[0.0, -1, 0], [0, 1, 0]]))
        if ((poles >= 0) & (poles <= [self.width, self.height])).all(axis=1).any():
            return math.inf
        image = np.dstack(np.meshgrid(*(np.arange(n + 1.0) for n in self.shape[::-1])))
        border = [image[0], image[-1], image[:, 0], image[:, -1]]
        right, down, ahead = self.toward(np.concatenate(border)).T
        return float(np.abs(down / np.hypot(right, ahead)).max())

    def toward(self, image: Floats) -> Floats:
        """Unit vectors (..., 3), in camera axes, through image coordinates (..., 2) in px.

        NaN outside of the image where the lens maps no direction.
        """
        plane = self._lens.undistorted((image - self._principal) / self._focal)
        radius = np.linalg.norm(plane, axis=-1, keepdims=True)
        if self.fisheye:
            rays = [np.sinc(radius / math.pi) * plane, np.cos(radius)]
        else:
            length = np.hypot(1, radius)
            rays = [plane / length, 1 / length]
        return np.concatenate(rays, axis=-1)

    def project(self, points: Floats) -> Floats:
        """Image coordinates (..., 2) in px of points (..., 3) in camera axes.

        Only directions count, so a point at infinity is given as its direction. NaN for points that
        are not in front of the camera, or within 1e-5 rad of its image plane (of a fisheye: behind
        it on the axis), and for those from where the lens turns back.
        """
        across, ahead = points[..., :2], points[..., 2:]
        radius = np.linalg.norm(across, axis=-1, keepdims=True)
        angle = np.arctan2(radius, ahead)
        if self.fisheye:
            angle = np.where(angle < math.pi - SINGULAR_RAD, angle, np.nan)
            plane = angle * across / np.maximum(radius, np.finfo(float).tiny)
        else:
            plane = across / np.where(angle < math.pi / 2 - SINGULAR_RAD, ahead, np.nan)
        return self._lens.distorted(plane) * self._focal + self._principal

    def undistortion_map(self) -> Floats:
        """Places of the pixels of a pinhole's image with the same matrix in this one (H, W, 2), px.

        Pixel centers are at integers, as in OpenCV. NaN where the lens maps nothing.
        """
        plane = (self.pixel_centers() - self._principal) / self._focal
        return self.project(np.dstack([plane, np.ones(self.shape)])) - 0.5

    def finer(self, parts: int) -> "OpenCVCamera":
        """Return the camera with each pixel divided into parts × parts."""
        (fx, fy), (cx, cy) = self._focal * parts, self._principal * parts - 0.5
        finer = {"fx_px": fx, "fy_px": fy, "cx_px": cx, "cy_px": cy}
        return super().finer(parts).model_copy(update=finer)

    def with_rows(self, rows: int) -> "OpenCVCamera":
        """Return the camera of a number of rows in the middle of the image."""
        cy = self.cy_px - (self.height - rows) / 2
        return self.model_copy(update={"height": rows, "cy_px": cy})

    @property
    def _focal(self) -> Floats:
        return np.array([self.fx_px, self.fy_px])

    @property
    def _principal(self) -> Floats:
        """Principal point (2,) in this program's image coordinates."""
        return np.array([self.cx_px + 0.5, self.cy_px + 0.5])

    @property
    def _lens(self) -> "_Lens":
        if self.fisheye:
            return _Lens(Polynomial([1, *self.fisheye]), Polynomial([1]), 0.0, 0.0)
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.distortion, *[0.0] * 8)[:8]
        return _Lens(Polynomial([1, k1, k2, k3]), Polynomial([1, k4, k5, k6]), p1, p2)


@compiled
def _bend(points, upper, lower, p1, p2):  # type: ignore[no-untyped-def]
    """Points (n, 2) distorted by g = upper / lower, polynomials, and the slopes (3, n)."""
    moved, slopes = np.empty((len(points), 2)), np.empty((3, len(points)))
    for n in range(len(points)):
        x, y = points[n]
        s = x * x + y * y
        above = above_slope = below = below_slope = 0.0
        for power in range(len(upper) - 1, -1, -1):  # Horner's scheme
            above_slope = above_slope * s + above
            above = above * s + upper[power]
        for power in range(len(lower) - 1, -1, -1):
            below_slope = below_slope * s + below
            below = below * s + lower[power]
        gain = above / below
        bend = 2 * (above_slope - gain * below_slope) / below
        mixed = 2 * (x * y)
        moved[n, 0] = x * gain + p1 * mixed + p2 * (s + 2 * (x * x))
        moved[n, 1] = y * gain + p2 * mixed + p1 * (s + 2 * (y * y))
        slopes[0, n] = gain + x * x * bend + 2 * p1 * y + 6 * p2 * x
        slopes[1, n] = x * y * bend + 2 * p1 * x + 2 * p2 * y
        slopes[2, n] = gain + y * y * bend + 6 * p1 * y + 2 * p2 * x
    return moved, slopes


@dataclass(frozen=True)
class _Lens:
    """Distortion of the plane: g = upper / lower, and two tangential coefficients.

    `cv2.projectPoints` and `cv2.undistortPoints` give the same to 1e-12 px, at two to three times
    the time, and accept no ray of a fisheye from behind its image plane.
    """

    upper: Polynomial
    lower: Polynomial
    p1: float
    p2: float

    def distorted(self, plane: Floats) -> Floats:
        """Distorted points (..., 2); NaN from where they turn back."""
        moved, (xx, xy, yy) = self._bent(plane)
        is_rising = ((plane**2).sum(axis=-1) < self._end) & (xx * yy - xy**2 > 0)
        return np.where(is_rising[..., None], moved, np.nan)

    def undistorted(self, wanted: Floats) -> Floats:
        """Points distorted to the wanted ones (..., 2), by Newton's method; NaN if none."""
        size = np.linalg.norm(wanted, axis=-1, keepdims=True)
        largest = most = float(np.nanmax(size, initial=1e-3))
        end = math.sqrt(self._end)
        while most < end and most * self._gain(most**2) < largest:
            most *= 2
        # The first guess is that of the radial part, from a table.
        radii = np.linspace(0, min(most, end), _TABLE)[:-1]
        radius = np.interp(size, radii * self._gain(radii**2), radii)
        plane = np.asarray(wanted * radius / np.maximum(size, np.finfo(float).tiny))
        with np.errstate(all="ignore"):  # where there are none
            for _ in range(_MOST_STEPS):
                moved, (xx, xy, yy) = self._bent(plane)
                x, y = np.moveaxis(wanted - moved, -1, 0)
                step = np.stack([yy * x - xy * y, xx * y - xy * x], axis=-1)
                step /= (xx * yy - xy**2)[..., None]
                plane = plane + step
                if np.nanmax(np.abs(step), initial=0) < _ACCURACY:
                    break
            is_exact = (np.abs(step) < _ACCURACY) & ~np.isnan(self.distorted(plane))
        return np.where(is_exact.all(axis=-1, keepdims=True), plane, np.nan)

    def growth(self, plane: Floats) -> Floats:
        """Area of the image over that of the plane, at points (..., 2)."""
        _, (xx, xy, yy) = self._bent(plane)
        return np.asarray(xx * yy - xy**2)

    def _gain(self, s: Floats | float) -> Floats:
        return np.asarray(self.upper(s) / self.lower(s))

    def _bent(self, plane: Floats) -> tuple[Floats, Floats]:
        """Distorted points (..., 2), and their slopes (3, ...): xx, xy = yx, yy."""
        rows = np.ascontiguousarray(plane, np.float64).reshape(-1, 2)
        moved, slopes = _bend(rows, self.upper.coef, self.lower.coef, self.p1, self.p2)
        return moved.reshape(plane.shape), slopes.reshape(3, *plane.shape[:-1])

    @property
    def _end(self) -> float:
        """Smallest s where the radial function √s·g(s) stops rising; infinite if it never does."""
        s, upper, lower = Polynomial([0.0, 1.0]), self.upper, self.lower
        slope = (upper + 2 * s * upper.deriv()) * lower - 2 * s * upper * lower.deriv()
        roots = np.concatenate([factor.trim().roots() for factor in (slope, lower)])
        is_real = np.abs(roots.imag) < 1e-9 * np.abs(roots)
        return float(min(roots.real[is_real & (roots.real > 0)], default=math.inf))
