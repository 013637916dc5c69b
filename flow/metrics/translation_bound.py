"""The Poisson translation bound: how well any method can tell the velocity of a block.

A texture of mean counts λ(x, y) that moves by v between frames is the harder to follow, the
fewer photons its gradients hold. The Fisher information of one frame on its displacement is, summed
over the pixels of a block,

    J = Σ ∇λ·∇λᵀ/λ          (2 × 2; along x alone Σ(∂λ/∂x)²/λ)

and n noisy frames of a steady velocity tell it no better than cov(v) ≥ J⁻¹/Σ(t − t̄)² with
Σ(t − t̄)² = n(n² − 1)/12: 2·J⁻¹ for two frames, J⁻¹/42 for eight (Cramér and Rao, to first order
in the displacement).

Assumed: unbiased estimates from the pixels of the block, and a texture that costs nothing to
learn (it is known up to its displacement). At few photons, where the texture must be learned from
the same counts and whole blocks are mistaken, no method comes near: below some hundred photons a
block the bound is optimistic. A method that returns x and y must be held against J⁻¹, whose x
component exceeds 1/J_xx where the gradients of a block favor one direction.
"""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from megalopta.flow.detectors import BlockGrid, FloatArray, block_sums

_ANGLES = (np.arange(64) + 0.5) * (np.pi / 64)
_SINGULAR = 1e-9
"""Share of J_xx·J_yy below which the determinant is rounding: gradients of one direction only."""


def fisher_information(means: FloatArray, grid: BlockGrid) -> FloatArray:
    """Return the Fisher information J of one frame on the displacement of each block.

    Parameters
    ----------
    means : (H, W)
        Mean counts λ. Gradients are those of the cubic spline through them.
    grid
        Blocks.

    Returns
    -------
    (rows, columns, 2, 2) in px⁻², components x, y.

    Raises
    ------
    ValueError
        When a mean is negative or not finite.
    """
    if not (np.isfinite(means).all() and means.min() >= 0):
        raise ValueError("means hold negative or non-finite values: give mean counts, 0 or more")
    gradient = [
        CubicSpline(np.arange(means.shape[axis]), means, axis=axis)(np.arange(means.shape[axis]), 1)
        for axis in (1, 0)
    ]
    # where the mean is 0 it is a minimum: no photons, no information
    weight = np.divide(1, means, out=np.zeros_like(means, np.float64), where=means > 0)
    xx, xy, yy = (
        block_sums(gradient[i] * gradient[j] * weight, grid) for i, j in ((0, 0), (0, 1), (1, 1))
    )
    return np.stack((xx, xy, xy, yy), axis=-1).reshape(*xx.shape, 2, 2)


def cramer_rao_covariance(information: FloatArray, frames: int = 2) -> FloatArray:
    """Return the least covariance of a block's velocity, (..., 2, 2) in (px/frame)².

    Parameters
    ----------
    information : (..., 2, 2)
        J of one frame, px⁻².
    frames : int
        Noisy frames of one velocity that the method uses.

    Returns
    -------
    Infinite where the gradients of a block have one direction only.
    """
    (xx, xy), (_, yy) = np.moveaxis(information, (-2, -1), (0, 1))
    determinant = xx * yy - xy**2
    solvable = determinant > _SINGULAR * xx * yy
    adjugate = np.stack((yy, -xy, -xy, xx), axis=-1).reshape(information.shape)
    spread = frames * (frames**2 - 1) / 12
    with np.errstate(divide="ignore", invalid="ignore"):
        covariance = adjugate / (determinant * spread)[..., np.newaxis, np.newaxis]
    return np.where(solvable[..., np.newaxis, np.newaxis], covariance, np.inf)


def cramer_rao_covariance_along_x(information: FloatArray, frames: int = 2) -> FloatArray:
    """Return the covariance (..., 2, 2) of a method that knows that nothing moves along y.

    Parameters as for `cramer_rao_covariance`.
    """
    spread = frames * (frames**2 - 1) / 12
    covariance = np.zeros_like(information)
    with np.errstate(divide="ignore"):
        covariance[..., 0, 0] = 1 / (information[..., 0, 0] * spread)
    return covariance


def median_endpoint_error(covariances: FloatArray) -> float:
    """Return the median length of normal errors of these covariances, pooled over the blocks.

    The length of A·z has the distribution 1 − exp(−ρ²/2σ²(φ)), averaged over the directions φ of z,
    with σ² = a·cos²φ + b·sin²φ and a, b the eigenvalues of the covariance.

    Parameters
    ----------
    covariances : (..., 2, 2)
        Infinite ones count as errors beyond all measure.

    Returns
    -------
    float
        px/frame; infinite when half of the covariances are.
    """
    each = covariances.reshape(-1, 2, 2)
    finite = each[np.isfinite(each).all(axis=(1, 2))]
    share = len(finite) / max(len(each), 1)
    if share <= 0.5:
        return float("inf")
    a, b = np.linalg.eigvalsh(finite).T
    variance = np.outer(a, np.cos(_ANGLES) ** 2) + np.outer(b, np.sin(_ANGLES) ** 2)
    scale = float(np.sqrt(np.median(variance)))

    def excess(log_length: float) -> float:
        length = scale * np.exp(log_length)
        return float(share * -np.expm1(-(length**2) / (2 * variance)).mean() - 0.5)

    return scale * float(np.exp(brentq(excess, -30, 30)))
