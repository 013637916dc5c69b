"""The bound on a velocity where the texture has to be learned from the same few counts.

The texture is a draw of a Gaussian process of known power spectrum S(ω), counts² per pixel, and
photons add white noise of variance σ², the mean count. In frames at times t, centered, a component
of the texture turns as u = exp(−i·ω·v·t), and k frames of it have the covariance S·u·uᴴ + σ²·I.
With the components independent and the texture integrated out, the Fisher information of n pixels
on the velocity v is

    F = (n/N)·Σ_ω ω·ωᵀ · S/σ² · k·S/(σ² + k·S) · Σ(t − t̄)²,      Σ(t − t̄)² = k(k² − 1)/12,

the sum running over the N frequencies of the spectrum (Slepian–Bangs formula; Kay, Fundamentals of
Statistical Signal Processing I, §3.9). The first factor is the information with known texture of
`translation_bound`; the second, below one, is what learning the texture costs. It rises toward one
where all frames together show a component well above their noise.

Assumed besides: motion that brings in no new texture, Gaussian texture, and unbiased estimates.
What a method knows beyond the spectrum, such as that leaves have edges, or slow motion, can take it
below the bound; blocks that are mistaken as a whole, which the bound leaves out, keep it above.
"""

import math

import numpy as np
from scipy.optimize import brentq

from megalopta.flow.detectors import FloatArray
from megalopta.flow.metrics.translation_bound import median_endpoint_error

_LOG_FLUXES = math.log(1e-6), math.log(1e15)


def texture_spectrum(images: FloatArray) -> FloatArray:
    """Return the mean power spectrum (H, W) of images (n, H, W), in their unit squared.

    Frequencies are in the order of `numpy.fft.fft2`; white noise of variance σ² has σ² everywhere.
    A Hann window keeps the borders out.
    """
    rows, columns = images.shape[1:]
    window = np.outer(np.hanning(rows + 2)[1:-1], np.hanning(columns + 2)[1:-1])
    window /= np.sqrt(np.sum(window**2))
    centered = images - images.mean(axis=(1, 2), keepdims=True)
    return np.asarray(np.mean(np.abs(np.fft.fft2(centered * window)) ** 2, axis=0))


def unknown_texture_information(
    spectrum: FloatArray, noise: float, pixels: int, frames: int = 2
) -> FloatArray:
    """Return the Fisher information (2, 2) on the velocity, (frame/px)², components x, y.

    Parameters
    ----------
    spectrum : (H, W)
        Power of the texture, counts² per pixel, in the order of `numpy.fft.fft2`.
    noise : float
        Variance of the noise of a pixel, counts²: with photons alone the mean count, above 0.
    pixels : int
        Pixels that are used.
    frames : int
        Frames of one velocity, all noisy.

    Raises
    ------
    ValueError
        When the noise is not above 0.
    """
    if not noise > 0:
        raise ValueError(f"noise {noise:g}: give the variance of a pixel's counts, above 0")
    rows, columns = spectrum.shape
    omega = 2 * np.pi * np.stack(np.meshgrid(np.fft.fftfreq(columns), np.fft.fftfreq(rows)))
    ratio = spectrum / noise
    weight = ratio * (frames * ratio / (1 + frames * ratio)) * frames * (frames**2 - 1) / 12
    return np.asarray(np.einsum("iyx,jyx,yx->ij", omega, omega, weight) * pixels / spectrum.size)


def unknown_texture_photons(
    spectrum: FloatArray, noise: float, pixels: int, frames: int, speed: float, level: float
) -> float:
    """Return the flux at which errors at the bound have a median of `level` of the speed.

    Parameters
    ----------
    spectrum, noise
        (H, W) and a number, at one photon per frame; they grow as the square of the flux and as
        the flux.
    pixels, frames
        As for `unknown_texture_information`.
    speed : float
        px per frame.
    level : float

    Returns
    -------
    float
        Photons per frame; infinite where the spectrum has waves of one direction only.
    """

    def excess(log_flux: float) -> float:
        flux = math.exp(log_flux)
        information = unknown_texture_information(spectrum * flux**2, noise * flux, pixels, frames)
        least = np.asarray(np.linalg.inv(information), np.float64)
        return math.log(median_endpoint_error(least) / (level * speed))

    if np.linalg.matrix_rank(unknown_texture_information(spectrum, noise, pixels)) < 2:
        return math.inf
    return math.exp(brentq(excess, *_LOG_FLUXES))
