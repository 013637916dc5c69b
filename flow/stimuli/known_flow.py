"""Light with known flow at every pixel: moving layers, and a panning camera.

**Layers.** A point X of a layer has the steady velocity u(X) = A·(X − c) + b, with c the middle of
the frame, so at time t it is at X + t·u(X). That map is affine, so where a point came from follows
without iteration: X = c + (1 + t·A)⁻¹·(x − c − t·b). Edges of upper layers are edges of the motion,
and hide what is below.

**Panorama.** A full turn on a cylinder, rows equidistant in the tangent of the elevation, as wide
along as across at the horizon. A perspective camera in its middle turns by the same rotation R
between any two frames; a pixel of homogeneous coordinates p moves to K·Rᵀ·K⁻¹·p, whatever the
distance of what it shows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats, Mask

_SAMPLES = 2
"""Samples along a pixel, which gathers their light"""

_PADDING = 8
"""Columns and rows beyond the edge, beyond which a cubic spline has decayed"""


@dataclass(frozen=True)
class Layer:
    """A texture that tiles the plane, its visible disk, and its motion."""

    texture: Floats
    """(rows, columns), `Layers.texels` of them to a pixel; without a seam in both directions"""
    velocity_px: tuple[float, float]
    """Velocity at the middle of the frame, x and y, px per frame"""
    gradient: Floats
    """A, (2, 2), 1/frame: gradient of the velocity (x, y) along x and y"""
    disk: tuple[float, float, float] | None = None
    """Center (x, y) from the middle of the frame, and radius, px; None: everywhere"""


@dataclass(frozen=True)
class MovingLayers:
    """Layers from the lowest to the uppermost, as seen by a camera with square pixels."""

    layers: Sequence[Layer]
    """The lowest must be everywhere"""
    texels: int = 2
    """Texels along a pixel, which integrates their light"""

    def light(self, shape: tuple[int, int], times: Sequence[float]) -> Floats:
        """Return frames of light at some times, (T, H, W), in the unit of the textures."""
        return np.stack([self._frame(shape, time) for time in times])

    def flow(self, shape: tuple[int, int], time: float) -> Floats:
        """Return the motion of visible content at a time over one frame, (H, W, 2), px."""
        positions = _pixels(shape, 1)
        flow = np.zeros((*shape, 2))
        for layer in self.layers:
            points, seen = _seen(layer, positions, time)
            velocity = points @ layer.gradient.T + layer.velocity_px
            flow = np.where(seen[..., np.newaxis], velocity, flow)
        return flow

    def hidden(self, shape: tuple[int, int], time: float) -> Mask:
        """Return where content visible at a time is behind an upper layer a frame later, (H, W)."""
        here = _pixels(shape, 1)
        there = here + self.flow(shape, time)
        covered = np.zeros(shape, np.bool_)
        for layer in self.layers:
            is_lower = ~_seen(layer, here, time)[1]
            covered = is_lower & (covered | _seen(layer, there, time + 1)[1])
        return covered

    def _frame(self, shape: tuple[int, int], time: float) -> Floats:
        n = self.texels
        positions = _pixels(shape, n)
        image = np.zeros(positions.shape[:2])
        for layer in self.layers:
            points, seen = _seen(layer, positions, time)
            texels = np.moveaxis(points[..., ::-1] * n, -1, 0)
            image = np.where(
                seen, map_coordinates(layer.texture, texels, order=1, mode="grid-wrap"), image
            )
        return np.asarray(image.reshape(shape[0], n, shape[1], n).mean(axis=(1, 3)))


@dataclass(frozen=True)
class PanningView:
    """View of a turning camera in a panorama."""

    panorama: Floats
    """(rows, columns), light of any unit; column m follows column 0"""
    focal_px: float
    """Focal length; columns/2π gives the horizon its native resolution"""
    heading_rad: float
    """Azimuth of the optical axis at time 0"""
    turn_rad: tuple[float, float, float]
    """Rotation vector of one frame about the axes right, down and forward of the camera"""

    def light(self, shape: tuple[int, int], times: Sequence[float]) -> Floats:
        """Return frames of light at some times, (T, H, W); not below 0.

        Raises ValueError if the camera looks beyond the upper or lower edge.
        """
        padded = np.pad(self.panorama, ((_PADDING, _PADDING), (0, 0)), mode="edge")
        padded = np.pad(padded, ((0, 0), (_PADDING, _PADDING)), mode="wrap")
        splines = spline_filter(padded, order=3)
        return np.stack([self._frame(splines, shape, time) for time in times])

    def flow(self, shape: tuple[int, int]) -> Floats:
        """Return the displacement of each pixel's content in one frame, (H, W, 2), px."""
        pixels = _pixels(shape, 1)
        turned = Rotation.from_rotvec(self.turn_rad).inv()
        rays = np.concatenate((pixels / self.focal_px, np.ones((*shape, 1))), axis=-1)
        moved = rays @ turned.as_matrix().T
        return np.asarray(self.focal_px * moved[..., :2] / moved[..., 2:] - pixels)

    def _frame(self, splines: Floats, shape: tuple[int, int], time: float) -> Floats:
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
        return np.asarray(np.maximum(light, 0))  # a spline overshoots below 0 beside a bright spot


def _pixels(shape: tuple[int, int], samples: int) -> Floats:
    """Return the places (x, y) of the samples of all pixels from the middle of the frame, px."""
    y, x = ((np.arange(side * samples) + 0.5) / samples - side / 2 for side in shape)
    return np.stack(np.meshgrid(x, y), axis=-1)


def _seen(layer: Layer, positions: Floats, time: float) -> tuple[Floats, Mask]:
    """Return the points of a layer at some places and a time, and whether it covers them."""
    back = np.linalg.inv(np.eye(2) + time * layer.gradient)
    points = (positions - time * np.asarray(layer.velocity_px)) @ back.T
    if layer.disk is None:
        return points, np.ones(points.shape[:-1], np.bool_)
    x, y, radius = layer.disk
    return points, np.asarray(np.hypot(points[..., 0] - x, points[..., 1] - y) < radius)
