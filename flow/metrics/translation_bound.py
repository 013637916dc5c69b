"""The Poisson translation bound: the best accuracy of a block's velocity by any method.

The Fisher information of one frame of mean counts λ(x, y) on its displacement, over the pixels of a
block, and the least covariance from n noisy frames of a steady velocity (Cramér and Rao, to first
order in the displacement):

    J = Σ ∇λ·∇λᵀ/λ          cov(v) ≥ J⁻¹/Σ(t − t̄)²          Σ(t − t̄)² = n(n² − 1)/12

for unbiased estimates from the pixels of the block, and a known texture; below some hundred photons
per block the bound is optimistic. For an unknown texture only the power spectrum is known. Both
bounds: `docs/explanation/poisson-bound.md`.

**Readings of a sensor** have in place of 1/λ the information of a reading about the mean number of
photoelectrons (`sensor.information`).
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import map_coordinates, spline_filter
from scipy.optimize import brentq

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.blocks import BlockGrid, block_sums
from megalopta.sensor import ImageSensor
from megalopta.sensor.information import information

_ANGLES = (np.arange(64) + 0.5) * (np.pi / 64)

_LOG_FLUXES = math.log(1e-6), math.log(1e15)


def fisher_information(means: Floats, grid: BlockGrid) -> Floats:
    """Return the Fisher information J of one frame on each block's displacement, px⁻².

    (rows, columns, 2, 2), components x, y, from mean counts λ (H, W), whose gradients are those of
    the cubic spline through them. Raises ValueError when one is negative or not finite.
    """
    if not (np.isfinite(means).all() and means.min() >= 0):
        raise ValueError("means hold negative or non-finite values: give mean counts, 0 or more")
    # a mean of 0 is a minimum: no photons, no information
    weight = np.divide(1, means, out=np.zeros_like(means, np.float64), where=means > 0)
    return ReadingSlopes(spline_gradient(means), weight).of_blocks(grid)


def spline_gradient(image: Floats) -> Floats:
    """Return the gradient (2, H, W) of the cubic spline through an image (H, W): along x, y."""
    places = [np.arange(size) for size in image.shape]
    slopes = [CubicSpline(places[axis], image, axis=axis)(places[axis], 1) for axis in (1, 0)]
    return np.stack(slopes)


def cramer_rao_covariance(information: Floats, frames: int = 2) -> Floats:
    """Return the least covariance of a block's velocity, (..., 2, 2) in (px/frame)².

    `information` (..., 2, 2): J of one frame, px⁻²; `frames`: noisy frames of one velocity that the
    method uses. Infinite where the gradients of a block have one direction only.

    Examples
    --------
    The least deviation of both components where gradients are alike in all directions:

    >>> np.sqrt(np.diag(cramer_rao_covariance(np.diag([50.0, 50.0]))))
    array([0.2, 0.2])
    """
    (xx, xy), (_, yy) = np.moveaxis(information, (-2, -1), (0, 1))
    determinant = xx * yy - xy**2
    solvable = determinant > 1e-9 * xx * yy  # else gradients have one direction
    adjugate = np.stack((yy, -xy, -xy, xx), axis=-1).reshape(information.shape)
    spread = frames * (frames**2 - 1) / 12
    with np.errstate(divide="ignore", invalid="ignore"):
        covariance = adjugate / (determinant * spread)[..., np.newaxis, np.newaxis]
    return np.where(solvable[..., np.newaxis, np.newaxis], covariance, np.inf)


def median_endpoint_error(covariances: Floats) -> float:
    """Return the median length of normal errors of these covariances (..., 2, 2), pooled, px/frame.

    The length of A·z has the distribution 1 − exp(−ρ²/2σ²(φ)), averaged over the directions φ of z,
    with σ² = a·cos²φ + b·sin²φ and a, b the eigenvalues of the covariance. Infinite covariances are
    errors beyond all measure; when half of them are, so is the median.
    """
    matrices = covariances.reshape(-1, 2, 2)
    finite = matrices[np.isfinite(matrices).all(axis=(1, 2))]
    share = len(finite) / max(len(matrices), 1)
    if share <= 0.5:
        return float("inf")
    a, b = np.linalg.eigvalsh(finite).T
    variance = np.outer(a, np.cos(_ANGLES) ** 2) + np.outer(b, np.sin(_ANGLES) ** 2)
    scale = float(np.sqrt(np.median(variance)))

    def excess(log_length: float) -> float:
        length = scale * np.exp(log_length)
        return float(share * -np.expm1(-(length**2) / (2 * variance)).mean() - 0.5)

    return scale * float(np.exp(brentq(excess, -30, 30)))


def texture_spectrum(images: Floats) -> Floats:
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
    spectrum: Floats, noise: float, pixels: int, frames: int = 2
) -> Floats:
    """Return the Fisher information (2, 2) on the velocity, (frame/px)², components x, y.

    By the Slepian–Bangs formula (Kay, Fundamentals of Statistical Signal Processing I, §3.9), from
    the texture's power `spectrum` (H, W), counts² per pixel, in the order of `numpy.fft.fft2`, and
    the `noise`, the variance of a pixel: with photons alone the mean count. ValueError if it is 0.
    """
    if not noise > 0:
        raise ValueError(f"noise {noise:g}: give the variance of a pixel's counts, above 0")
    rows, columns = spectrum.shape
    omega = 2 * np.pi * np.stack(np.meshgrid(np.fft.fftfreq(columns), np.fft.fftfreq(rows)))
    ratio = spectrum / noise
    weight = ratio * (frames * ratio / (1 + frames * ratio)) * frames * (frames**2 - 1) / 12
    return np.asarray(np.einsum("iyx,jyx,yx->ij", omega, omega, weight) * pixels / spectrum.size)


def unknown_texture_photons(
    spectrum: Floats, noise: float, pixels: int, frames: int, speed: float, level: float
) -> float:
    """Return the flux at which errors at the bound have a median of `level` of the speed.

    As `unknown_texture_information`, but `spectrum` (H, W) and `noise` are those of one photon per
    frame; `speed`: px per frame. Infinite where waves have one direction only.
    """

    def excess(log_flux: float) -> float:
        flux = math.exp(log_flux)
        information = unknown_texture_information(spectrum * flux**2, noise * flux, pixels, frames)
        least = np.asarray(np.linalg.inv(information), np.float64)
        return math.log(median_endpoint_error(least) / (level * speed))

    if np.linalg.matrix_rank(unknown_texture_information(spectrum, noise, pixels)) < 2:
        return math.inf
    return math.exp(brentq(excess, *_LOG_FLUXES))


_PARTS_PER_PX = 2


class ReadingSlopes(NamedTuple):
    """Change of the light of pixels with its displacement, and what readings tell of the light."""

    gradient: Floats
    """Gradient (2, H, W) of the mean photoelectrons along x and y, per px"""
    information: Floats
    """Information (H, W) of a reading on these, electrons⁻²"""

    def of_blocks(self, grid: BlockGrid) -> Floats:
        """Return J of each block, (rows, columns, 2, 2), px⁻²."""
        x, y = self.gradient
        xx, xy, yy = (block_sums(part * self.information, grid) for part in (x * x, x * y, y * y))
        return np.stack((xx, xy, xy, yy), axis=-1).reshape(*xx.shape, 2, 2)

    def of_turn(self, flow: Floats) -> float:
        """Return the information on one number that moves pixels by a flow (H, W, 2) per unit."""
        along = np.einsum("ayx,yxa->yx", self.gradient, flow)
        return float(np.sum(along**2 * self.information))


def reading_slopes(light_hz: Floats, sensor: ImageSensor) -> ReadingSlopes:
    """Return how the light of pixels changes with its displacement, and what a sensor tells of it.

    `light_hz` (H, W): photons per second that identical pixels detect (`detected_rate`); the
    differences of the sensor's pixels are added.
    """
    electrons = light_hz * sensor.exposure_s
    return ReadingSlopes(spline_gradient(electrons), information(electrons, sensor))


def blurred_by_motion(light: Floats, way: Floats) -> Floats:
    """Return the mean of light (H, W) that moves along a straight way (H, W, 2), px.

    The way is centered on each pixel, and the light is the cubic spline through the pixels.
    """
    parts = math.ceil(_PARTS_PER_PX * float(np.hypot(*np.moveaxis(way, -1, 0)).max()))
    if not parts:
        return light
    coefficients, centers = spline_filter(light, mode="nearest"), np.indices(light.shape)
    times = (np.arange(parts + 1) + 0.5) / (parts + 1) - 0.5
    way_yx = np.moveaxis(way[..., ::-1], -1, 0)
    moved = [
        map_coordinates(coefficients, centers - time * way_yx, prefilter=False, mode="nearest")
        for time in times
    ]
    return np.asarray(np.mean(moved, axis=0)).clip(0)
