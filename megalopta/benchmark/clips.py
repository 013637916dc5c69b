"""Clips of the board of whole frames: eight frames of light, and the flow in their middle.

Motion is steady. Two-frame methods see the two frames in the middle, eight-frame methods all. Both
are compared with the flow between the two frames in the middle.
"""

import math
from dataclasses import dataclass

import numpy as np

from megalopta.assets_gen import generator
from megalopta.assets_gen.surface_textures import dead_leaves
from megalopta.core.arrays import Floats, Mask
from megalopta.flow.detectors.base import Frames
from megalopta.flow.stimuli.known_flow import Layer, MovingLayers
from megalopta.flow.stimuli.photons import Counts, draw_counts

SHAPE = (240, 240)
FRAMES = 8
TIMES = tuple(range(1 - FRAMES // 2, FRAMES // 2 + 1))
"""-3 to 4: the flow is that from 0 to 1"""

RADII_PX = (3.0, 80.0)
_TEXELS = 2
_TEXTURE_PX = 320
_FASTEST_PX = 4.0
_STEEPEST = 0.008
"""Largest change of velocity between neighboring pixels, px per frame"""

_DISKS = 3
_DISK_RADII_PX = (30.0, 55.0)


@dataclass(frozen=True)
class FlowClip:
    """A few frames of light and their motion."""

    name: str
    light: Floats
    """(T, H, W), T even, of mean 1"""
    flow: Floats
    """(H, W, 2), px, between the two frames in the middle, on the pixels of the first"""
    hidden: Mask | None = None
    """(H, W), pixels that something else hides in the second of them; None: unknown"""

    def counts(self, flux: float, draw: int, key: tuple[str, ...] = ()) -> Counts:
        """Return a draw (T, H, W) of `flux` photons per pixel; the key seeds it."""
        return draw_counts(self.light * flux, 0, *key, self.name, f"{flux:.6g}", draw)


def leaves_clip(
    seed: int, shape: tuple[int, int] = SHAPE, fastest_px: float = _FASTEST_PX
) -> FlowClip:
    """Return dead leaves in an affine motion, and three disks of them in other motions."""
    rng = generator(seed, "whole frames, leaves")
    side = _TEXTURE_PX * _TEXELS
    smallest, largest = (radius * _TEXELS for radius in RADII_PX)
    texture = dead_leaves((side, side), rng, (smallest, largest))
    return layers_clip(f"leaves {seed}", rng, texture, shape, fastest_px)


def layers_clip(
    name: str,
    rng: np.random.Generator,
    texture: Floats,
    shape: tuple[int, int],
    fastest_px: float = _FASTEST_PX,
) -> FlowClip:
    """Return a texture without a seam in an affine motion, and three disks of it in others."""
    layers = [_layer(rng, texture, None)]
    for _ in range(_DISKS):
        x, y = ((rng.random() - 0.5) * 0.8 * side for side in shape[::-1])
        disk = x, y, rng.uniform(*_DISK_RADII_PX)
        layers.append(_layer(rng, texture, disk, fastest_px))
    scene = MovingLayers(layers, _TEXELS)
    hidden = scene.hidden(shape, 0)
    return _clip(name, scene.light(shape, TIMES), scene.flow(shape, 0), hidden)


def middle(frames: Frames, count: int) -> Frames:
    """Return the `count` frames in the middle of a sequence."""
    first = (len(frames) - count) // 2
    return frames[first : first + count]


def _layer(
    rng: np.random.Generator,
    texture: Floats,
    disk: tuple[float, float, float] | None,
    fastest_px: float = _FASTEST_PX,
) -> Layer:
    """Return a layer of another part of the texture, with its own motion."""
    elsewhere = np.roll(texture, rng.integers(texture.shape), axis=(0, 1))
    speed, angle = rng.uniform(0.5, fastest_px), rng.uniform(0, 2 * math.pi)
    velocity = speed * math.cos(angle), speed * math.sin(angle)
    return Layer(elsewhere, velocity, rng.uniform(-_STEEPEST, _STEEPEST, (2, 2)), disk)


def _clip(name: str, light: Floats, flow: Floats, hidden: Mask) -> FlowClip:
    return FlowClip(name, light / light.mean(), flow, hidden)
