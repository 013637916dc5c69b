"""Band-limited noise: tileable images, and smooth random fields of the plane."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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

    Parameters
    ----------
    size_m : (float, float)
        Extent of the rows' and of the columns' direction (m).
    wavelengths_m : (float, float)
        Shortest and longest wavelength present (m).
    exponent : float
        Amplitude falls as frequency to the minus `exponent`; 1 gives all octaves equal contrast.
    stretch : float
        Features are this many times longer along the rows' index (v) than across.
    """
    fv = np.fft.fftfreq(shape[0], size_m[0] / shape[0])[:, None] * stretch
    fu = np.fft.rfftfreq(shape[1], size_m[1] / shape[1])[None, :]
    frequency = np.hypot(fu, fv)
    band = (frequency >= 1 / wavelengths_m[1]) & (frequency <= 1 / wavelengths_m[0])
    gain = np.where(band, np.maximum(frequency, 1e-12) ** -exponent, 0)
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * gain, shape)
    return np.asarray(field / field.std())


def to_weight(signal: FloatArray) -> NDArray[np.float32]:
    """Return a signal around 0, of any shape, as a weight in [0, 1], 1/2 where it is 0."""
    return np.asarray(0.5 + 0.5 * np.tanh(signal), dtype=np.float32)


_AT_ONCE = 1024
"""Points of a field that are computed together: few enough for the processor's cache."""


@dataclass(frozen=True)
class PlaneWaves:
    """A smooth random field of the plane: a sum of cosine waves in random directions."""

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
