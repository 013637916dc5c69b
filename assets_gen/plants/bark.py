"""Bark patterns as tileable weights between a light and a dark reflectance (1), and reliefs.

Each pattern has contrast from half a meter down to the texel, because motion detectors need it.
Furrows and texture come from one pattern, so that furrows are dark; the mean radius is unchanged.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from megalopta.assets_gen import FloatArray
from megalopta.assets_gen.plants.skeleton import tube_uv
from megalopta.assets_gen.plants.species import Buttresses
from megalopta.assets_gen.tileable_noise import Marks, strew, tileable_noise, to_weight

TILE_M = (0.8, 1.6)
"""Size of one tile around and along the trunk (m)."""
SHAPE = (1024, 512)
"""Texels along and around."""


def _noise(
    wavelengths_m: tuple[float, float], exponent: float, rng: np.random.Generator, stretch: float
) -> FloatArray:
    return tileable_noise(SHAPE, TILE_M[::-1], wavelengths_m, exponent, rng, stretch)


def smooth_bark(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return beech-like bark (H, W): soft blotches, lichen, fine horizontal wrinkles."""
    blotches = _noise((0.05, 0.6), 1.4, rng, 1.5)
    lichen = np.maximum(_noise((0.015, 0.25), 1.2, rng, 1.2) - 0.9, 0)
    wrinkles = np.minimum(_noise((0.004, 0.12), 0.6, rng, 0.15), 0)
    grain = _noise((0.0035, 0.02), 0.3, rng, 1.0)
    return to_weight(0.45 * blotches - 1.3 * lichen - 0.45 * wrinkles + 0.22 * grain)


def papery_bark(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return birch-like bark (H, W): white, with thin dark bands and black diamond scars."""
    shade = (
        -0.95
        + 0.35 * _noise((0.03, 0.5), 1.2, rng, 0.5)
        + 0.18 * _noise((0.0035, 0.03), 0.4, rng, 0.3)
    )
    bands = strew(SHAPE, TILE_M[::-1], 620, Marks((0.015, 0.11), 0.1, np.pi / 2, 0.06), rng)
    scars = strew(SHAPE, TILE_M[::-1], 24, Marks((0.05, 0.2), 0.4, np.pi / 2, 0.25), rng)
    crack = _noise((0.004, 0.1), 0.9, rng, 2.0)
    dark = np.where(
        np.isnan(scars), np.where(np.isnan(bands), -9.0, 0.35 + bands), 1.2 + 0.4 * crack
    )
    return to_weight(np.maximum(shade, dark))


def _plates(
    centers: FloatArray, squeeze: float, warp_m: FloatArray
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the distance of texels from the border of their plate (m), and the index of the plate.

    Plates surround centers (n, 2) (m), with a ratio of width to height of `squeeze`; `warp_m` (H,
    W, 2) makes their borders ragged.
    """
    rows, columns = SHAPE
    size = np.array(TILE_M[::-1])
    v, u = np.meshgrid(
        (np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns, indexing="ij"
    )
    texels = (np.stack([v, u], axis=-1) * size + warp_m) % size
    # Plates are taller than wide: measure distances on a squeezed torus.
    squeezed = np.array([squeeze, 1.0])
    tree = cKDTree(centers * squeezed, boxsize=size * squeezed)
    distance, plate = tree.query(texels.reshape(-1, 2) * squeezed % (size * squeezed), k=2)
    return np.diff(distance, axis=-1).reshape(SHAPE), np.asarray(plate)[:, 0].reshape(SHAPE)


def scaly_bark(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return spruce-like bark (H, W): small plates of different shade between dark cracks."""
    centers = rng.random((1500, 2)) * np.array(TILE_M[::-1])
    warp = np.stack([_noise((0.02, 0.2), 1.0, rng, 1.0) for _ in range(2)], axis=-1)
    gap, plate = _plates(centers, 0.6, 0.006 * warp)
    shade = rng.normal(0, 0.45, len(centers))[plate]
    cracks = 1.9 * np.exp(-gap / 0.0035)
    broad = 0.35 * _noise((0.1, 0.8), 1.2, rng, 2.0)
    grain = 0.25 * _noise((0.0035, 0.03), 0.4, rng, 1.5)
    return to_weight(cracks - 0.55 + shade + broad + grain)


def ridged_bark(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return oak-like bark (H, W) to be carved: long ragged ridges between broad furrows."""
    return _carvable(190, 0.2, 0.012, (0.25, 3.0), rng)


def plated_bark(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return pine-like bark (H, W) to be carved: large flaky plates between broad cracks."""
    return _carvable(330, 0.5, 0.008, (0.4, 1.2), rng)


def _carvable(
    count: int,
    squeeze: float,
    furrow_m: float,
    flakes: tuple[float, float],
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Return plates between furrows of a width, with flakes of a contrast and a stretch."""
    centers = rng.random((count, 2)) * np.array(TILE_M[::-1])
    along, across = (_noise((0.02, 0.25), 0.9, rng, 2.0) for _ in range(2))
    gap, plate = _plates(centers, squeeze, np.stack([0.03 * along, 0.009 * across], axis=-1))
    furrows = 1.7 * np.exp(-((gap / furrow_m) ** 2))
    shade = rng.normal(0, 0.2, count)[plate] + 0.3 * _noise((0.1, 0.8), 1.2, rng, 2.0)
    chips = flakes[0] * _noise((0.008, 0.06), 0.8, rng, flakes[1])
    grain = 0.2 * _noise((0.0035, 0.02), 0.4, rng, 2.0)
    return to_weight(furrows - 0.75 + shade + chips + grain)


def furrowed_bark(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return oak-like bark (H, W): long ridges that split and join between deep dark furrows."""
    waves = _noise((0.03, 0.12), 0.6, rng, 5.0)
    furrows = np.exp(-((waves / 0.3) ** 2))
    cracks = np.maximum(_noise((0.01, 0.06), 0.5, rng, 0.4) - 1.0, 0)
    broad = 0.3 * _noise((0.1, 0.8), 1.2, rng, 2.0)
    grain = 0.3 * _noise((0.0035, 0.03), 0.4, rng, 2.0)
    return to_weight(1.9 * furrows + 0.8 * cracks - 0.8 + broad + grain)


GRAIN_M = (0.012, 0.035)
"""Mesh steps of the carved stem, around and along it (m)."""
SIDES = 24, 112
"""Fewest and most sides of a carved stem."""
CARVED_M = 2.5, 4.0
"""Heights at which furrows begin to fade and end (m)."""
DEEPEST = 0.25
"""Largest depth of furrows, relative to the stem's radius."""


@dataclass(frozen=True)
class Furrows:
    """Furrows of one kind of bark."""

    pattern: NDArray[np.float32]
    """(H, W): 0 on ridges to 1 in furrows, over one tile of the bark's texture."""
    depth_m: float
    """Depth of furrows (m)."""

    def carved(
        self,
        axis: FloatArray,
        profile: FloatArray,
        tile_m: tuple[float, float],
        uv_origin: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return axis (l, 3) and profile (l - 1, sides) of a stem as for `swept_tube`, carved."""
        radius = float(profile.mean(axis=1).max())
        sides = int(np.clip(np.ceil(2 * np.pi * radius / GRAIN_M[0]), *SIDES))
        # more rings where furrows are, and more sides
        z, nodes = axis[:, 2], np.arange(len(axis), dtype=float)
        top = min(CARVED_M[1], z[-2])
        at = np.interp(np.arange(z[0], top, GRAIN_M[1]), z, nodes)
        at = np.union1d(at.round(6), nodes)
        axis = np.stack([np.interp(at, nodes, axis[:, i]) for i in range(3)], axis=-1)
        around = np.fft.irfft(np.fft.rfft(profile, axis=1) / profile.shape[1], sides, axis=1)
        columns = (around * sides).T
        profile = np.stack([np.interp(at[:-1], nodes[:-1], column) for column in columns], axis=-1)
        u, v = np.moveaxis(tube_uv(axis, profile, tile_m, whole_tiles=True)[:-1], -1, 0)
        place = np.stack([v, u]).reshape(2, -1, sides + 1)[..., :-1] + uv_origin[::-1, None, None]
        steps = np.array(GRAIN_M[::-1]) / tile_m[::-1] * self.pattern.shape
        smooth = gaussian_filter(self.pattern.astype(float), steps / 3, mode="wrap")
        texels = place * np.array(smooth.shape)[:, None, None] - 0.5
        depth = map_coordinates(smooth, texels, order=1, mode="grid-wrap") - smooth.mean()
        z = axis[:-1, 2]
        shown = np.clip((CARVED_M[1] - z) / (CARVED_M[1] - CARVED_M[0]), 0, 1) * (z > -0.1)
        most = min(self.depth_m, DEEPEST * radius)
        return axis, profile - most * shown[:, None] * depth


BUTTRESSED_SIDES = 36
"""Sides of a stem with buttresses: enough for their edges."""


def root_flare(
    z: FloatArray, sides: int, radius_m: float, flare: float, rng: np.random.Generator
) -> FloatArray:
    """Return the factor (k, sides) by which the stem widens into roots near the ground.

    Roots are lobes of two incommensurate numbers around the stem, so that no two are alike.
    """
    angle = 2 * np.pi * np.arange(sides) / sides
    first, second = rng.uniform(0, 2 * np.pi, 2)
    lobes = 0.6 + 0.3 * np.cos(3 * angle + first) + 0.25 * np.cos(5 * angle + second)
    decay = np.exp(-np.maximum(z, 0) / (2.2 * radius_m))
    return np.asarray(1 + flare * decay[:, None] * np.maximum(lobes, 0.1))


def buttress_flare(
    z: FloatArray, sides: int, buttresses: Buttresses, rng: np.random.Generator
) -> FloatArray:
    """Return the factor (k, sides) by which buttresses widen the stem."""
    count = buttresses.count
    middles = 2 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    angle = 2 * np.pi * np.arange(sides)[:, None] / sides
    walls = np.cos((angle - middles) / 2) ** 18
    reach = buttresses.reach * rng.uniform(0.6, 1.2, count)
    tall = buttresses.height_m * rng.uniform(0.7, 1.2, count)
    fall = np.exp(-np.maximum(z, 0)[:, None] / tall)
    return np.asarray(1 + (reach * fall) @ walls.T)
