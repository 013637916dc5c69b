"""A camera that turns inside a panorama: a pure rotation, whose flow is known at every pixel.

The panorama is a full turn on a cylinder, rows equidistant in the tangent of the elevation, as wide
along as across at the horizon. A perspective camera in its middle turns by the same rotation R
between any two frames; a pixel of homogeneous coordinates p moves to K·Rᵀ·K⁻¹·p, whatever the
distance of what it shows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter
from scipy.spatial.transform import Rotation

from megalopta.flow.detectors import FloatArray

_SAMPLES = 2
"""Samples along a pixel, which gathers their light"""

_PADDING = 8
"""Columns and rows beyond the edge, which a cubic spline forgets"""


@dataclass(frozen=True)
class PanningView:
    """What a turning camera sees of a panorama."""

    panorama: FloatArray
    """(rows, columns), light of any unit; column m follows column 0"""

    focal_px: float
    """Focal length; columns/2π sees the horizon as sharp as it is"""

    heading_rad: float
    """Azimuth of the optical axis at time 0"""

    turn_rad: tuple[float, float, float]
    """Rotation vector of one frame about the axes right, down and forward of the camera"""

    def light(self, shape: tuple[int, int], times: Sequence[float]) -> FloatArray:
        """Return frames of light at some times, (T, H, W); not below 0.

        Raises
        ------
        ValueError
            When the camera looks beyond the upper or lower edge.
        """
        padded = np.pad(self.panorama, ((_PADDING, _PADDING), (0, 0)), mode="edge")
        padded = np.pad(padded, ((0, 0), (_PADDING, _PADDING)), mode="wrap")
        splines = spline_filter(padded, order=3)
        return np.stack([self._frame(splines, shape, time) for time in times])

    def flow(self, shape: tuple[int, int]) -> FloatArray:
        """Return how far each pixel's content moves in one frame, (H, W, 2), px."""
        pixels = _pixels(shape, 1)
        turned = Rotation.from_rotvec(self.turn_rad).inv()
        rays = np.concatenate((pixels / self.focal_px, np.ones((*shape, 1))), axis=-1)
        moved = rays @ turned.as_matrix().T
        return np.asarray(self.focal_px * moved[..., :2] / moved[..., 2:] - pixels)

    def _frame(self, splines: FloatArray, shape: tuple[int, int], time: float) -> FloatArray:
        rows, columns = self.panorama.shape
        pixels = _pixels(shape, _SAMPLES)
        rays = np.concatenate((pixels / self.focal_px, np.ones((*pixels.shape[:2], 1))), axis=-1)
        turn = Rotation.from_rotvec(time * np.asarray(self.turn_rad)).as_matrix()
        right, down, forward = np.moveaxis(rays @ turn.T, -1, 0)
        per_rad = columns / (2 * np.pi)
        azimuth = self.heading_rad + np.arctan2(right, forward)
        row = per_rad * down / np.hypot(right, forward) + rows / 2 - 0.5
        if row.min() < -1 or row.max() > rows:
            raise ValueError(
                f"focal_px {self.focal_px:g}: the camera looks beyond the panorama's edge at time "
                f"{time:g}; give a longer one, smaller frames or a slower turn"
            )
        column = (azimuth * per_rad) % columns
        places = np.stack((row, column)) + _PADDING
        fine = map_coordinates(splines, places, order=3, prefilter=False)
        n = _SAMPLES
        light = fine.reshape(shape[0], n, shape[1], n).mean(axis=(1, 3))
        return np.asarray(np.maximum(light, 0))  # a spline swings below 0 beside a bright spot


def _pixels(shape: tuple[int, int], samples: int) -> FloatArray:
    y, x = ((np.arange(side * samples) + 0.5) / samples - side / 2 for side in shape)
    return np.stack(np.meshgrid(x, y), axis=-1)
