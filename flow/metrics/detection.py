"""Discrimination of motion from rest, and of left from right: ROC, d′ and false alarms.

The evidence is one number per block and frame for all methods: a velocity, or the mean over the
block of a correlation detector's responses, so that it uses as much light as a block's velocity
(some methods use more than their block, as documented). For motion it is the length
of the velocity, or the absolute mean; for the direction the component to the right, with its sign.
A block without velocity has evidence 0.

A threshold on the evidence gives hits and false alarms; all thresholds give the receiver operating
characteristic (ROC). The area A under it is the probability that a signal exceeds a noise, ties
counting half, without assumptions on distributions. d′ = √2·Φ⁻¹(A) expresses it for two Gaussians
of equal width: their distance over their standard deviation (Green and Swets 1966).
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.blocks import BlockDetector, block_grid, block_sums


@dataclass(frozen=True)
class Roc:
    """Receiver operating characteristic: from (0, 0), at the highest threshold, to (1, 1)."""

    false_alarms: Floats
    """Share of the noise above each threshold"""
    hits: Floats
    """Share of the signals above each threshold"""


def motion_evidence(detector: Detector, responses: Floats) -> Floats:
    """Return the evidence for motion of each inner block, (T, rows, columns).

    For responses (T, H, W) absolute means, for (T − 1, rows, columns, 2) speeds in px per frame; 0
    where undefined.
    """
    return np.asarray(np.hypot(*_components(detector, responses)))


def rightward_evidence(detector: Detector, responses: Floats) -> Floats:
    """Return the signed evidence for motion to the right, (T, rows, columns)."""
    return np.asarray(_components(detector, responses)[0])


def roc(noise: Floats, signal: Floats) -> Roc:
    """Return hits against false alarms for all thresholds on the evidence.

    `noise`, `signal`, of any shapes: evidence without and with the signal. Raises ValueError if
    either is empty or holds NaN.
    """
    _check(noise, signal)
    thresholds = np.unique(np.concatenate((noise, signal), axis=None))[::-1]
    shares = [
        np.concatenate(
            ([0.0], 1 - np.searchsorted(np.sort(each, axis=None), thresholds) / each.size)
        )
        for each in (noise, signal)
    ]
    return Roc(*shares)


def roc_auc(noise: Floats, signal: Floats) -> float:
    """Return the area under the ROC: the probability that a signal exceeds a noise, ties half.

    Raises ValueError if either is empty or holds NaN.
    """
    _check(noise, signal)
    ordered = np.sort(noise, axis=None)
    below, not_above = (np.searchsorted(ordered, signal, side) for side in ("left", "right"))
    return float(np.mean(below + not_above) / (2 * noise.size))


def d_prime(noise: Floats, signal: Floats) -> float:
    """Return d′ = √2·Φ⁻¹(A) of samples of any shape; negative if noise is more often larger.

    Samples without overlap only show that d′ is large: the area is kept half a pair away from 0 and
    1, which limits d′ to 6.1 with 256 noises and 256 signals.

    Raises ValueError if either is empty or holds NaN.
    """
    measured = roc_auc(noise, signal)
    half_a_pair = 0.5 / (float(noise.size) * signal.size)
    kept = min(max(measured, half_a_pair), 1 - half_a_pair)
    return math.sqrt(2) * float(ndtri(kept))


def _components(detector: Detector, responses: Floats) -> Floats:
    """Return x and y of the evidence, (2, T, rows, columns)."""
    if isinstance(detector, BlockDetector):
        return np.nan_to_num(np.moveaxis(responses[:, 1:-1, 1:-1], -1, 0), nan=0.0)
    grid = block_grid((responses.shape[1], responses.shape[2]))
    means = [block_sums(each, grid)[1:-1, 1:-1] / grid.block_px**2 for each in responses]
    return np.stack((means, np.zeros_like(means)))


def _check(*evidence: Floats) -> None:
    for each in evidence:
        if each.size == 0 or np.isnan(each).any():
            raise ValueError(
                f"evidence of shape {each.shape}: give at least one number, and no NaN"
            )
