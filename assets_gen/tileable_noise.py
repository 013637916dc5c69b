"""Band-limited noise: tileable images, scattered marks, smooth random fields of the plane.

Leaf-shaped marks are scattered over a tileable image, small ones on top of large ones. Objects that
occlude each other ("dead leaves", Matheron 1968; Lee, Mumford & Huang 2001, IJCV 41:35) give images
the edges and the scale-free spectrum of natural scenes, which filtered noise lacks.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from megalopta.assets_gen import FloatArray


def tileable_noise(
    shape: tuple[int, int],
    size_m: tuple[float, float],
    wavelengths_m: tuple[float, float],
    exponent: float,
    rng: np.random.Generator,
    stretch: float = 1.0,
) -> FloatArray:
    """Return noise that repeats without a seam, mean 0, variance 1, shape (H, W).

    It has wavelengths from the shortest to the longest. Amplitude falls as frequency to the minus
    `exponent`; 1 gives all octaves equal contrast. Features are longer along v by `stretch`.
    """
    fv = np.fft.fftfreq(shape[0], size_m[0] / shape[0])[:, None] * stretch
    fu = np.fft.rfftfreq(shape[1], size_m[1] / shape[1])[None, :]
    frequency = np.hypot(fu, fv)
    band = (frequency >= 1 / wavelengths_m[1]) & (frequency <= 1 / wavelengths_m[0])
    gain = np.zeros(frequency.shape)
    gain[band] = frequency[band] ** -exponent
    field = fft.irfft2(fft.rfft2(rng.standard_normal(shape)) * gain, shape)
    return np.asarray(field / field.std())


def to_weight(signal: FloatArray) -> NDArray[np.float32]:
    """Return a signal around 0, of any shape, as a weight in [0, 1], 1/2 where it is 0."""
    return np.asarray(0.5 + 0.5 * np.tanh(signal), dtype=np.float32)


_AT_ONCE = 1024
"""Points of a field computed together: few enough for the processor's cache."""


@dataclass(frozen=True)
class PlaneWaves:
    """Smooth random field of the plane: a sum of cosine waves in random directions."""

    wave_vectors: FloatArray
    """(n, 2): rad/m."""
    phases: FloatArray
    """(n,): rad."""
    amplitudes: FloatArray
    """(n,): the field's unit; the variance is half the sum of their squares."""

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the field at points (…, 2) (m), shape (…)."""
        flat = points.reshape(-1, 2)
        value = np.empty(len(flat))
        for first in range(0, len(flat), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            wave = flat[part, :1] * self.wave_vectors[:, 0]
            wave += flat[part, 1:] * self.wave_vectors[:, 1]
            wave += self.phases
            np.cos(wave, out=wave)
            wave *= self.amplitudes
            value[part] = wave.sum(axis=-1)
        return value.reshape(points.shape[:-1])


def plane_waves(
    wavelengths_m: tuple[float, float], rms: float, count: int, rng: np.random.Generator
) -> PlaneWaves:
    """Return `count` random waves, wavelengths log-uniform, amplitude growing with wavelength."""
    wavelength = np.exp(rng.uniform(np.log(wavelengths_m[0]), np.log(wavelengths_m[1]), count))
    azimuth = rng.uniform(0, 2 * np.pi, count)
    direction = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    amplitude = wavelength * rms * np.sqrt(2 / np.sum(wavelength**2))
    vectors = 2 * np.pi / wavelength[:, None] * direction
    return PlaneWaves(vectors, rng.uniform(0, 2 * np.pi, count), amplitude)


WAVES = 56
"""Plane waves of a band."""
SAMPLED = 2.0, 3.5
"""Mesh points per shortest wave of a band below which it is absent, and above which it is
complete."""


Rough = Callable[[FloatArray, FloatArray], FloatArray]
"""Field (n,) at points (n, 2) of a mesh with steps (n,) (m), limited to the mesh's resolution."""


def make_octaves(
    bands: Sequence[tuple[tuple[float, float], float]], rms: float, rng: np.random.Generator
) -> Rough:
    """Return a random field of bands with a total root mean square, where all are resolved.

    Bands are shortest and longest wavelength (m) and their share of the contrast.
    """
    norm = np.sqrt(sum(part**2 for _, part in bands))
    waves = [plane_waves(lengths, rms * part / norm, WAVES, rng) for lengths, part in bands]

    def field(points: FloatArray, step_m: FloatArray) -> FloatArray:
        total = np.zeros(len(points))
        for band, ((shortest, _), _) in zip(waves, bands, strict=True):
            share = np.clip((shortest / step_m - SAMPLED[0]) / (SAMPLED[1] - SAMPLED[0]), 0, 1)
            shown = share > 0
            total[shown] += share[shown] * band(points[shown])
        return total

    return field


CHUNK = 1024
"""Marks drawn at once; another number gives other marks."""
PAINTED = 64
"""Marks painted at once: of similar length, and few enough for the processor's cache."""


@dataclass(frozen=True)
class Marks:
    """Look of scattered marks."""

    lengths_m: tuple[float, float]
    """Shortest and longest mark; lengths are log-uniform."""
    aspect: float
    """Width over length."""
    heading: float = 0.0
    """Mean direction of the marks' length from the row axis (v) toward the column axis (u), rad;
    π/2 lies along a row."""
    spread: float = 3.0
    """Standard deviation of the direction (rad); 3 is any."""


def strew(
    shape: tuple[int, int],
    size_m: tuple[float, float],
    count: int,
    marks: Marks,
    rng: np.random.Generator,
) -> FloatArray:
    """Return an image (H, W) of shaded marks, NaN where there are none; it tiles without a seam.

    Rows and columns extend over `size_m` (m). The generator draws positions, sizes, directions and
    shades, which are standard normal, times 0.5.
    """
    image = np.full(shape[0] * shape[1], np.nan)
    texel = np.array(size_m) / shape
    shortest, longest = np.log(marks.lengths_m)
    lengths = np.sort(np.exp(rng.uniform(shortest, longest, count)))[::-1]
    for start in range(0, count, CHUNK):
        length = lengths[start : start + CHUNK]
        angle = marks.heading + marks.spread * rng.standard_normal(len(length))
        center = rng.random((len(length), 2)) * size_m
        shade = 0.5 * rng.standard_normal(len(length))
        for first in range(0, len(length), PAINTED):
            painted = slice(first, first + PAINTED)
            long = length[painted, None]
            reach = np.ceil(long.max() / 2 / texel).astype(int)
            middle = np.floor(center[painted] / texel).astype(int)
            rows, columns = (
                middle[:, axis, None] + np.arange(-reach[axis], reach[axis] + 1) for axis in (0, 1)
            )
            down = (rows + 0.5) * texel[0] - center[painted, :1]
            right = (columns + 0.5) * texel[1] - center[painted, 1:]
            cosine, sine = np.cos(angle[painted, None]), np.sin(angle[painted, None])
            along = (down * cosine)[:, :, None] + (right * sine)[:, None]
            along *= 2
            along /= long[..., None]
            across = (right * cosine)[:, None] - (down * sine)[:, :, None]
            across *= 2
            across /= marks.aspect * long[..., None]
            # A lens, pointed at both ends; one half is darker, as of a folded leaf.
            mark, row, column = np.nonzero(np.abs(across) < 1 - along**2)
            along, across = along[mark, row, column], across[mark, row, column]
            # For repeated indices numpy keeps the last value, so later marks are on top.
            place = rows[mark, row] % shape[0] * shape[1] + columns[mark, column] % shape[1]
            image[place] = shade[painted][mark] + 0.12 * np.sign(across) + 0.1 * along
    return image.reshape(shape)
