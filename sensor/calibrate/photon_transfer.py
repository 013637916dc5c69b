"""Photon transfer: the step of a counter from how the variance of readings grows with their mean.

Poisson events of step s on an output of offset a, leak l and read noise r make

    mean = a + l·T + s·λ      variance = r² + s²·λ = r² + s·(mean − a − l·T)

so the slope of variance over mean is the step. No comb has to be seen. The leak is neglected, which
makes the step small by the leak over that of the dark counts, l/(s·d): 0.3 % for SPADCAM. In the
dark mean and exposure grow together, so that the data could hardly tell it. Of the levels only dim
ones are used, where dead time has not yet made the counts more regular.

Source: EMVA 1288 release 4, Linear.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.level import Falls

_ROUNDS = 6
_DIMMEST = 3.0
"""Levels with up to so many times the least light are used, and those in the dark."""


class PhotonTransfer(NamedTuple):
    """Line of each pixel, (P,)."""

    step_v: Floats
    step_error_v: Floats
    read_variance_v2: Floats
    offset_v: Floats
    """Fall of the output without counts at no exposure (V)."""
    offset_error_v: Floats


def photon_transfer(falls: Falls, above_noise: float = 0.0) -> PhotonTransfer:
    """Fit variance over mean, and mean over exposure in the dark.

    Levels whose fall is below so many standard deviations are not used: the ADC may cut off part
    of their readings.
    """
    light_hz = falls.light_hz
    is_dim = light_hz <= _DIMMEST * light_hz[light_hz > 0].min(initial=np.inf)
    used = (falls.frames > 0) & is_dim[:, None]
    used &= falls.mean_v >= above_noise * np.sqrt(falls.variance_v2)
    offset, offset_error = _intercept(falls, used & (light_hz == 0)[:, None])
    columns = np.stack([np.ones_like(falls.mean_v), falls.mean_v - offset], axis=-1)
    scale = np.abs(columns).max(axis=0, keepdims=True) + 1e-30
    floor = 1e-3 * float(np.median(falls.variance_v2)) + 1e-18
    expected = np.maximum(falls.variance_v2, floor)
    for _ in range(_ROUNDS):
        weight = np.where(used, (np.maximum(falls.frames, 2) - 1) / (2 * expected**2), 0)
        solution, covariance = _least_squares(columns / scale, falls.variance_v2, weight)
        fitted = np.einsum("lpi,pi->lp", columns / scale, solution)
        expected = np.maximum(fitted, floor)
    solution = solution / scale[0]
    error = np.sqrt(covariance[:, 1, 1]) / scale[0, :, 1]
    return PhotonTransfer(solution[:, 1], error, solution[:, 0].clip(0), offset, offset_error)


def _intercept(falls: Falls, used: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Fall at no exposure in the dark, and its standard error."""
    variance = falls.variance_v2 / np.maximum(falls.frames, 1) + 1e-18
    weight = np.where(used, 1 / variance, 0)
    times = np.broadcast_to(falls.exposure_s[:, None], falls.mean_v.shape)
    columns = np.stack([np.ones_like(times), times / times.max()], axis=-1)
    solution, covariance = _least_squares(columns, falls.mean_v, weight)
    return solution[:, 0], np.sqrt(covariance[:, 0, 0])


def _least_squares(columns: Floats, values: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Weighted fits over levels for every pixel: solutions (P, k) and covariances (P, k, k)."""
    normal = np.einsum("lp,lpi,lpj->pij", weight, columns, columns)
    right = np.einsum("lp,lpi,lp->pi", weight, columns, values)
    covariance = np.linalg.pinv(normal, hermitian=True)
    return np.einsum("pij,pj->pi", covariance, right), covariance
