"""Textures by name, as weights in [0, 1] between two reflectances; ground and leaves.

**Dead leaves**: opaque disks that fall on each other until they cover the ground.

With radii of density r⁻³ the image is scale-invariant and has the statistics of natural scenes that
matter to motion detectors: occlusion edges, large plain areas, a power-law spectrum (Lee, Mumford
and Huang, Int. J. Comput. Vision 41, 35, 2001). Disks are painted from front to back, so each
paints only bare parts.
"""

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen import FloatArray
from megalopta.assets_gen.bodies import STONE_TILE_M
from megalopta.assets_gen.plants import bark
from megalopta.assets_gen.plants.foliage import ATLAS_TILES, TONES
from megalopta.assets_gen.terrain import GROUND_TILE_M
from megalopta.assets_gen.tileable_noise import Marks, strew, tileable_noise, to_weight
from megalopta.core.compiling import compiled

GROUND_SHAPE = (1024, 1024)
LEAF_TEXELS = 64
"""Rows and columns of one leaf in the atlas."""


def _on_ground(per_m2: int, marks: Marks, rng: np.random.Generator) -> FloatArray:
    count = int(per_m2 * GROUND_TILE_M**2)
    return strew(GROUND_SHAPE, (GROUND_TILE_M, GROUND_TILE_M), count, marks, rng)


def _ground_noise(
    wavelengths_m: tuple[float, float], exponent: float, rng: np.random.Generator
) -> FloatArray:
    size = GROUND_TILE_M, GROUND_TILE_M
    return tileable_noise(GROUND_SHAPE, size, wavelengths_m, exponent, rng)


def litter_texture(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return a tileable floor of fallen leaves and twigs; 1 is bright litter, 0 bare soil."""
    leaves = _on_ground(750, Marks((0.035, 0.12), 0.5), rng)
    twigs = _on_ground(12, Marks((0.1, 0.4), 0.04), rng)
    patches = _ground_noise((0.15, 1.8), 1.1, rng)
    grain = _ground_noise((0.01, 0.06), 0.4, rng)
    soil = -1.3 + 0.5 * grain
    litter = np.where(np.isnan(leaves), soil, leaves - 0.1 + 0.15 * grain)
    # Litter is thin where the patches' noise is low, so that soil is visible.
    floor = np.where(patches + 0.3 * grain > -0.6, litter, soil)
    floor = np.where(np.isnan(twigs), floor, 0.9 * twigs - 0.2)
    return to_weight(1.5 * floor + 0.45 * patches - 0.35)


def turf_texture(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return a tileable short turf or carpet of moss: fine blades on large patches; 1 is bright."""
    blades = _on_ground(1200, Marks((0.03, 0.11), 0.12), rng)
    patches = _ground_noise((0.15, 2.5), 1.0, rng)
    grain = _ground_noise((0.01, 0.06), 0.4, rng)
    turf = np.where(np.isnan(blades), -0.9 + 0.4 * grain, 0.3 + blades)
    return to_weight(turf + 0.4 * patches)


def moss_texture(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return a tileable carpet of moss: soft cushions, dark gaps, few leaves; 1 is bright."""
    cushions = _ground_noise((0.04, 0.35), 0.9, rng)
    patches = _ground_noise((0.3, 2.5), 1.0, rng)
    grain = _ground_noise((0.01, 0.05), 0.2, rng)
    leaves = _on_ground(9, Marks((0.035, 0.09), 0.5), rng)
    moss = 0.4 * cushions + 0.35 * patches + 0.3 * grain + 0.1
    return to_weight(np.where(np.isnan(leaves), moss, leaves - 1.4))


def trodden_texture(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return a tileable path of bare soil with pebbles and bits of leaves; 1 is bright."""
    crumbs = _on_ground(500, Marks((0.012, 0.05), 0.55), rng)
    pebbles = _on_ground(40, Marks((0.015, 0.06), 0.8), rng)
    twigs = _on_ground(10, Marks((0.08, 0.3), 0.05), rng)
    damp = _ground_noise((0.2, 2.5), 1.0, rng)
    grain = _ground_noise((0.01, 0.15), 0.6, rng)
    soil = 0.6 * damp + 0.3 * grain - 0.65
    soil = np.where(np.isnan(crumbs), soil, soil + 1.1 * crumbs + 0.1)
    soil = np.where(np.isnan(pebbles), soil, 0.5 + pebbles)
    return to_weight(np.where(np.isnan(twigs), soil, 0.9 * twigs - 0.6))


def _leaf_coordinates() -> tuple[FloatArray, FloatArray]:
    """Position along the midrib and distance from it, in leaves, of every texel of the atlas."""
    place = (np.arange(ATLAS_TILES * LEAF_TEXELS) + 0.5) / LEAF_TEXELS % 1
    v, u = np.meshgrid(np.tile(place, TONES), place, indexing="ij")
    return v, np.abs(u - 0.5)


def _blades(marks: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return atlases of blades with the marks, each with its own shade, and blotches over all.

    They are lighter from atlas to atlas, and from old to young leaves.
    """
    blotches = tileable_noise(marks.shape, (8.0 * TONES, 8.0), (0.05, 0.8), 1.0, rng)
    tones = rng.uniform(-0.5, 0.5, (TONES, ATLAS_TILES, ATLAS_TILES))
    tones += np.linspace(-0.9, 0.3, TONES)[:, None, None] + np.linspace(-0.4, 0.4, ATLAS_TILES)
    tones = tones.reshape(-1, ATLAS_TILES)
    shades = tones.repeat(LEAF_TEXELS, axis=0).repeat(LEAF_TEXELS, axis=1)
    return shades + marks + 0.25 * blotches


def leaf_texture(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return atlases of leaves of many shades with veins and blotches; 1 is lightest."""
    v, off = _leaf_coordinates()
    veins = 0.8 * (off < 0.03) + 0.45 * ((7 * (v - 1.2 * off)) % 1 < 0.16)
    return to_weight(_blades(veins, rng) - 0.15)


def needle_texture(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return atlases of needle sprays: bright needles over dark gaps, slanted off the twig."""
    v, off = _leaf_coordinates()
    needles = np.cos(2 * np.pi * 11 * (v - 0.9 * off)) - 1.0 * (off < 0.04)
    return to_weight(_blades(0.6 * needles, rng))


def stone_texture(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return granite, 0, with grain, stains and spots of lichen, under moss, 1, at its top."""
    shape, size = (512, 512), (STONE_TILE_M, STONE_TILE_M)
    grain = tileable_noise(shape, size, (0.005, 0.03), 0.2, rng)
    stains = tileable_noise(shape, size, (0.06, 1.2), 1.2, rng)
    lichen = strew(shape, size, 60, Marks((0.03, 0.12), 0.9), rng)
    stone = 0.15 * grain + 0.2 * stains - 1.1
    stone = np.where(np.isnan(lichen), stone, stone + 0.4 + 0.3 * lichen)
    # Boulders reach from −0.3 at the ground, which is 0.7, to 0.65 at their top.
    height = (np.arange(shape[0])[:, None] / shape[0] + 0.3) % 1
    cushions = 2.5 * (height - 0.62) / 0.3 + 0.8 * stains + 0.3 * grain
    return to_weight(np.maximum(stone, np.minimum(cushions, 0.9 + 0.3 * grain)))


def mossy_texture(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return tileable old bark, 0, with cushions of moss, 1."""
    shape, size = (512, 512), (1.6, 0.8)
    cushions = tileable_noise(shape, size, (0.08, 0.8), 1.0, rng)
    fibers = tileable_noise(shape, size, (0.01, 0.1), 0.5, rng, 4.0)
    return to_weight(2.2 * cushions + 0.6 * fibers - 0.6)


TEXTURES: Mapping[str, Callable[[np.random.Generator], NDArray[np.float32]]] = {
    "furrowed": bark.furrowed_bark,
    "smooth": bark.smooth_bark,
    "papery": bark.papery_bark,
    "scaly": bark.scaly_bark,
    "ridged": bark.ridged_bark,
    "plated": bark.plated_bark,
    "leaf": leaf_texture,
    "needles": needle_texture,
    "litter": litter_texture,
    "turf": turf_texture,
    "moss": moss_texture,
    "trodden": trodden_texture,
    "stone": stone_texture,
    "mossy": mossy_texture,
}
"""Textures by name: a weight (H, W) in [0, 1]; all except leaf atlases tile."""


_SAMPLES = 3
"""Samples along a pixel, for edges as soft as those of a sensor's pixels"""


def dead_leaves(
    shape: tuple[int, int], rng: np.random.Generator, radii_px: tuple[float, float] = (1.5, 80.0)
) -> FloatArray:
    """Return an image (H, W) of disks that tiles without a seam in both directions.

    Radii have density r⁻³ between the smallest and the largest, values are uniform from 0.1 to 1.
    Raises ValueError if radii are not in increasing order above 0, or a disk would be wider than
    the image.
    """
    low, high = radii_px
    if not 0 < low <= high:
        raise ValueError(f"radii_px {low} … {high}: give two in increasing order, above 0")
    if 2 * high > min(shape):
        raise ValueError(
            f"radii_px up to {high}: the disks are wider than the image of {shape[0]} ×"
            f" {shape[1]} px; give at most half of its shorter side"
        )
    image = np.zeros((shape[0] * _SAMPLES, shape[1] * _SAMPLES))
    _cover(image, rng, (float(low * _SAMPLES), float(high * _SAMPLES)))
    return np.asarray(image.reshape(shape[0], _SAMPLES, shape[1], _SAMPLES).mean(axis=(1, 3)))


@compiled
def _cover(image: FloatArray, rng: np.random.Generator, radii: tuple[float, float]) -> None:
    """Paint leaves until nothing is bare."""
    (height, width), bare = image.shape, image.size
    most, least = radii[0] ** -2, radii[1] ** -2
    while bare:
        # the inverse of the cumulative distribution of r⁻³
        radius = (least + rng.random() * (most - least)) ** -0.5
        row, column = rng.random() * height, rng.random() * width
        value = 0.1 + 0.9 * rng.random()
        # the bare part (0) of a disk on the torus; samples are at the centers of their squares
        for y in range(math.ceil(row - radius - 0.5), math.ceil(row + radius - 0.5)):
            for x in range(math.ceil(column - radius - 0.5), math.ceil(column + radius - 0.5)):
                seen = (y + 0.5 - row) ** 2 + (x + 0.5 - column) ** 2 < radius**2
                if seen and image[y % height, x % width] == 0:
                    image[y % height, x % width] = value
                    bare -= 1
