"""Leaf-shaped marks strewn over a tileable image, small ones on top of large ones.

Objects that hide each other ("dead leaves", Matheron 1968; Lee, Mumford & Huang 2001, IJCV 41:35)
give images the edges and the scale-free spectrum of natural scenes, which filtered noise lacks.
"""

import numpy as np

from megalopta.assets_gen import FloatArray

CHUNK = 1024
"""Marks drawn at once; another number draws other marks."""
PAINTED = 64
"""Marks painted at once: of like length, and few enough to stay in the processor's cache."""


def strew(
    shape: tuple[int, int],
    size_m: tuple[float, float],
    count: int,
    lengths_m: tuple[float, float],
    aspect: float,
    heading: float,
    spread: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Return an image (H, W) of shaded marks, NaN where none lies; it tiles without a seam.

    Parameters
    ----------
    shape, size_m
        Rows and columns, and their extent (m).
    lengths_m : (float, float)
        Shortest and longest mark (m); lengths are log-uniform.
    aspect : float
        Width over length.
    heading, spread : float
        Mean direction of the marks' length from the row axis (v) toward the column axis (u), and
        its standard deviation (rad); π/2 lies along a row.
    rng : Generator
        Positions, sizes, directions and shades; shades are standard normal, times 0.5.
    """
    image = np.full(shape[0] * shape[1], np.nan)
    texel = np.array(size_m) / shape
    lengths = np.sort(np.exp(rng.uniform(np.log(lengths_m[0]), np.log(lengths_m[1]), count)))[::-1]
    for start in range(0, count, CHUNK):
        length = lengths[start : start + CHUNK]
        n = len(length)
        angle = heading + spread * rng.standard_normal(n)
        center = rng.random((n, 2)) * size_m
        shade = 0.5 * rng.standard_normal(n)
        for few in (slice(first, first + PAINTED) for first in range(0, n, PAINTED)):
            flat, value = _paint(
                shape, texel, center[few], length[few], aspect, angle[few], shade[few]
            )
            # Repeated indices: numpy keeps the last value, so later marks lie on top.
            image[flat] = value
    return image.reshape(shape)


def _paint(
    shape: tuple[int, int],
    texel: FloatArray,
    center: FloatArray,
    length: FloatArray,
    aspect: float,
    angle: FloatArray,
    shade: FloatArray,
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.intp]], FloatArray]:
    """Return the texels that each mark covers and their shades, in the order of the marks."""
    reach = np.ceil(length.max() / 2 / texel).astype(int)
    offsets = np.stack(
        np.meshgrid(*(np.arange(-r, r + 1) for r in reach), indexing="ij"), axis=-1
    ).reshape(-1, 2)
    index = np.floor(center / texel).astype(int)[:, None] + offsets
    away = (index + 0.5) * texel - center[:, None]
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    along = 2 * (away[..., 0] * cosine + away[..., 1] * sine) / length[:, None]
    across = 2 * (away[..., 1] * cosine - away[..., 0] * sine) / (aspect * length[:, None])
    # A lens outline, pointed at both ends; one half darker than the other, like a folded leaf.
    inside = np.abs(across) < 1 - along**2
    value = shade[:, None] + 0.12 * np.sign(across) + 0.1 * along
    flat = (index[..., 0] % shape[0]) * shape[1] + index[..., 1] % shape[1]
    return flat[inside], value[inside]
