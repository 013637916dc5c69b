"""Errors of a dense flow, pixel by pixel, in the measures of the public benchmarks.

EPE is the length of the difference. A pixel counts for the 1, 3 and 5 px rates when its EPE is
larger, and for Fl when its EPE is larger than 3 px and 5 % of the true motion (KITTI 2015). WAUC
(Richter, Hayder and Koltun 2017) weighs the share of pixels within i/20 px by 1 − (i − 1)/100,
i = 1 … 100: 100 is perfect. The angular error is that between (u, v, 1) of flow and truth.

Pixels whose truth is undefined are not scored. A pixel for which the program gave no flow is beyond
every limit, its EPE and angle are those of the answer 0, and the share of these is given: silence
does not pay.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.flow.detectors.base import FloatArray
from megalopta.flow.metrics.endpoint_error import angles_deg

SPEEDS_PX = (10.0, 40.0)
"""Bounds of the three groups of true motion, px per frame (MPI-Sintel: s0-10, s10-40, s40+)"""

_THRESHOLDS_PX = (1.0, 3.0, 5.0)
_RELATIVE = 0.05
_STEPS = 100
_MEASURES = 9


@dataclass(frozen=True)
class DenseError:
    """Means over the pixels of a group; NaN where it has none. In px per frame, %, or degrees."""

    pixels: int
    """Number of pixels whose truth is known"""
    epe_px: float
    """Mean endpoint error over all pixels"""
    epe_of_images_px: float
    """Mean over images of their mean endpoint error"""
    epe_rms_px: float
    """Root of the mean squared endpoint error over all pixels"""
    over_1px_percent: float
    over_3px_percent: float
    over_5px_percent: float
    fl_percent: float
    """Pixels off by more than 3 px and by more than 5 % of the true motion"""
    wauc_percent: float
    angular_deg: float
    missing_percent: float
    """Pixels without an answer"""


GROUPS = ("all", "visible", "occluded", "slow", "medium", "fast")
"""All pixels; those that are seen in the next frame or not; those that move by less than 10 px,
by 10 to 40, by more"""


class DenseErrors:
    """Sums of errors by group of pixels, to which images are added one at a time."""

    def __init__(self) -> None:
        # pixels, images, sum of the images' mean EPE, sums over pixels of every measure
        self._sums = {name: np.zeros(3 + _MEASURES) for name in GROUPS}

    def add(
        self,
        flow: NDArray[np.floating],
        truth: NDArray[np.floating],
        occluded: NDArray[np.bool_] | None = None,
    ) -> None:
        """Score one image.

        Parameters
        ----------
        flow, truth : (H, W, 2)
            px per frame, NaN where undefined.
        occluded : (H, W), optional
            Pixels that are not seen in the next frame; without it none counts as occluded.

        Raises
        ------
        ValueError
            When shapes differ, or no pixel has an answer.
        """
        if flow.shape != truth.shape:
            raise ValueError(
                f"a flow of {flow.shape[1]} × {flow.shape[0]} px, the truth has"
                f" {truth.shape[1]} × {truth.shape[0]}: give it at full size"
            )
        if occluded is not None and occluded.shape != truth.shape[:2]:
            raise ValueError(f"occluded of shape {occluded.shape}: give {truth.shape[:2]}")
        known = np.asarray(np.isfinite(truth).all(axis=-1))
        hidden = np.zeros_like(known) if occluded is None else occluded
        true, answer = truth[known].astype(np.float64), flow[known].astype(np.float64)
        if len(true) and not np.isfinite(answer).all(axis=-1).any():
            raise ValueError(
                "no flow where the truth is known: a frame without an answer has no score"
            )
        measures = _measures(answer, true)
        for name, among in _groups(true, hidden[known]).items():
            if among.any():
                found = measures[:, among]
                means = [found.shape[1], 1.0, found[0].mean()]
                self._sums[name] += np.concatenate((means, found.sum(axis=1)))

    @classmethod
    def joined(cls, parts: Iterable["DenseErrors"]) -> "DenseErrors":
        """Return the errors over the images of several."""
        joined = cls()
        for part in parts:
            for name, sums in part._sums.items():
                joined._sums[name] += sums
        return joined

    def of(self, group: str) -> DenseError:
        """Return the errors of one of `GROUPS`."""
        pixels, images, image_epe, *sums = self._sums[group].tolist()
        if not pixels:
            return DenseError(0, *(math.nan,) * 10)
        epe, square, *shares, angle = (each / pixels for each in sums)
        *percents, missing = (100 * share for share in shares)
        values = [epe, image_epe / images, math.sqrt(square), *percents, angle, missing]
        return DenseError(int(pixels), *values)


def _measures(answer: FloatArray, true: FloatArray) -> FloatArray:
    """What is averaged over pixels, (measures, pixels)."""
    missing = np.asarray(~np.isfinite(answer).all(axis=-1))
    answer = np.where(missing[:, np.newaxis], 0.0, answer)
    epe = np.hypot(*(answer - true).T)
    off = np.where(missing, np.inf, epe)
    over = [off > limit for limit in _THRESHOLDS_PX]
    fl = over[1] & (off > _RELATIVE * np.hypot(*true.T))
    return np.array([epe, epe**2, *over, fl, _wauc(off), missing, angles_deg(answer, true)])


def _wauc(epe: FloatArray) -> FloatArray:
    """Share of the weights of all thresholds within which an error lies."""
    within = np.clip(_STEPS + 1 - np.maximum(np.ceil(epe * _STEPS / 5), 1), 0, _STEPS)
    return np.asarray(within * (within + 1) / (_STEPS * (_STEPS + 1)))


def _groups(true: FloatArray, hidden: NDArray[np.bool_]) -> dict[str, NDArray[np.bool_]]:
    speed = np.hypot(*true.T)
    slow, fast = SPEEDS_PX
    return {
        "all": np.ones_like(hidden),
        "visible": ~hidden,
        "occluded": hidden,
        "slow": speed < slow,
        "medium": (speed >= slow) & (speed < fast),
        "fast": speed >= fast,
    }
