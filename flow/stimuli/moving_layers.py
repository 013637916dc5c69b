"""Opaque layers of texture, each with an affine motion of its own: flow known at every pixel.

A point X of a layer has the steady velocity u(X) = A·(X − c) + b, with c the middle of the frame,
so at time t it is at X + t·u(X). That map is affine, so where a point came from follows without
iteration: X = c + (1 + t·A)⁻¹·(x − c − t·b). Edges of upper layers are edges of the motion, and
hide what is below.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from megalopta.flow.detectors import FloatArray


@dataclass(frozen=True)
class Layer:
    """A texture that tiles the plane, the disk of it that is there, and how it moves."""

    texture: FloatArray
    """(rows, columns), `Layers.texels` of them to a pixel; without a seam in both directions"""

    velocity_px: tuple[float, float]
    """Of the point at the middle of the frame, x and y, px per frame"""

    gradient: FloatArray
    """A, (2, 2), 1/frame: how the velocity (x, y) grows along x and y"""

    disk: tuple[float, float, float] | None = None
    """Middle (x, y) from the middle of the frame, and radius, px; None is everywhere"""


@dataclass(frozen=True)
class MovingLayers:
    """Layers from the lowest to the uppermost, as a camera with square pixels sees them."""

    layers: Sequence[Layer]
    """The lowest is to be everywhere"""

    texels: int = 2
    """Texels along a pixel, which gathers their light"""

    def light(self, shape: tuple[int, int], times: Sequence[float]) -> FloatArray:
        """Return frames of light at some times, (T, H, W), in the unit of the textures."""
        return np.stack([self._frame(shape, time) for time in times])

    def flow(self, shape: tuple[int, int], time: float) -> FloatArray:
        """Return the motion of what is seen at a time over one frame, (H, W, 2), px."""
        positions = _pixels(shape, 1)
        flow = np.zeros((*shape, 2))
        for layer in self.layers:
            points, seen = _seen(layer, positions, time)
            velocity = points @ layer.gradient.T + layer.velocity_px
            flow = np.where(seen[..., np.newaxis], velocity, flow)
        return flow

    def _frame(self, shape: tuple[int, int], time: float) -> FloatArray:
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


def _pixels(shape: tuple[int, int], samples: int) -> FloatArray:
    """Return the places (x, y) of the samples of all pixels from the middle of the frame, px."""
    y, x = ((np.arange(side * samples) + 0.5) / samples - side / 2 for side in shape)
    return np.stack(np.meshgrid(x, y), axis=-1)


def _seen(
    layer: Layer, positions: FloatArray, time: float
) -> tuple[FloatArray, np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
    """Return which points of a layer are at some places at a time, and whether it has them."""
    back = np.linalg.inv(np.eye(2) + time * layer.gradient)
    points = (positions - time * np.asarray(layer.velocity_px)) @ back.T
    if layer.disk is None:
        return points, np.ones(points.shape[:-1], np.bool_)
    x, y, radius = layer.disk
    return points, np.asarray(np.hypot(points[..., 0] - x, points[..., 1] - y) < radius)
