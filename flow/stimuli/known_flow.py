"""Light with known flow at every pixel: moving layers.

A point X of a layer has the steady velocity u(X) = A·(X − c) + b, with c the middle of
the frame, so at time t it is at X + t·u(X). That map is affine, so where a point came from follows
without iteration: X = c + (1 + t·A)⁻¹·(x − c − t·b). Edges of upper layers are edges of the motion,
and hide what is below.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from megalopta.core.arrays import Floats, Mask


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
        n, frames = self.texels, []
        positions = _pixels(shape, n)
        for time in times:
            image = np.zeros(positions.shape[:2])
            for layer in self.layers:
                points, seen = _seen(layer, positions, time)
                texels = np.moveaxis(points[..., ::-1] * n, -1, 0)
                light = map_coordinates(layer.texture, texels, order=1, mode="grid-wrap")
                image = np.where(seen, light, image)
            frames.append(image.reshape(shape[0], n, shape[1], n).mean(axis=(1, 3)))
        return np.stack(frames)

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
        positions = _pixels(shape, 1)
        moved = positions + self.flow(shape, time)
        covered = np.zeros(shape, np.bool_)
        for layer in self.layers:
            is_lower = ~_seen(layer, positions, time)[1]
            covered = is_lower & (covered | _seen(layer, moved, time + 1)[1])
        return covered


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
