"""Responses and errors of one detector on one exposure, a few frames at a time.

References are the mean of the readings ("self") and the photons ("perfect").
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import for_sensor
from megalopta.flow.metrics.endpoint_error import block_share, truth_error, truth_splits
from megalopta.flow.metrics.response_error import METRICS, error_of, error_sums, for_json
from megalopta.sensor import ImageSensor

Record = dict[str, Any]
Scaled = tuple[NDArray[Any], float]

SATURATED_SHARE = 0.1
"""Blocks with a larger saturated share, in either frame of a pair, are excluded on request"""


@dataclass(frozen=True, eq=False)
class SeenFrames:
    """The next frames of an exposure, (n, H, W) each, with the factors to a mean of 1."""

    counts: Scaled
    mean_reading: Scaled
    photons: Scaled | None
    corrected: Scaled | None
    saturated: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class BlockTruth:
    """True velocities (T − 1, rows, columns, 2) of a detector's blocks, and their hidden share."""

    velocities: Floats
    without_mixed: Floats
    """Velocities of blocks without their mixed pixels"""
    hidden: Floats
    """(T − 1, rows, columns): hidden share of each block."""


class SequenceMeasurement:
    """A detector on an exposure; `add` returns its responses, `record` their errors.

    Parameters
    ----------
    detector
    shape : (rows, columns)
    truth : BlockTruth or None
        For a detector that gives velocities.
    warm_up : int
        Frames in which the detector settles.
    leaves_out_saturated : bool
        True excludes saturated pixels, or blocks with many of them.
    sensor : ImageSensor
        That of the readings, whose noise the detector knows.
    """

    def __init__(
        self,
        detector: Detector,
        shape: tuple[int, int],
        truth: BlockTruth | None,
        warm_up: int,
        leaves_out_saturated: bool,
        sensor: ImageSensor,
    ) -> None:
        self._detector, self._truth, self._warm_up = detector, truth, warm_up
        self._leaves_out = leaves_out_saturated
        of_readings = for_sensor(detector, sensor)
        self._to_counts, self._to_mean, self._to_photons, self._to_corrected = (
            each.start(shape) for each in (of_readings, of_readings, detector, detector)
        )
        self._sums: dict[str, list[Floats]] = {}
        self._velocities: dict[str, list[Floats]] = {}
        self._left_out: list[NDArray[np.bool_]] = []
        self._last_saturated: NDArray[np.bool_] | None = None

    def add(self, frames: SeenFrames) -> tuple[Floats, Floats]:
        """Add the next frames; return the responses to their means and to the counts."""
        ideal, noisy = self._to_mean(*frames.mean_reading), self._to_counts(*frames.counts)
        left_out = self._saturated(frames.saturated, ideal)
        answers = {"ideal": ideal, "counts": noisy}
        self._add_sums("error", ideal, noisy, left_out)
        if frames.photons is not None:
            perfect = self._to_photons(*frames.photons)
            self._add_sums("error_perfect", perfect, noisy, left_out)
            if frames.corrected is not None and not self._detector.takes_counts:
                corrected = self._to_corrected(*frames.corrected)
                answers["corrected"] = corrected
                self._add_sums("error_corrected", perfect, corrected, left_out)
        if self._truth is not None:
            self._left_out.append(left_out)
            for name, velocities in answers.items():
                self._velocities.setdefault(name, []).append(velocities)
        return ideal, noisy

    def record(self) -> Record:
        """Return the errors of all frames."""
        record: Record = {"method": self._detector.name, "warm_up_frames": self._warm_up}
        for name, chunks in self._sums.items():
            sums = np.concatenate(chunks, axis=1)[:, self._warm_up :]
            record[name] = {metric: for_json(error_of(sums, metric)) for metric in METRICS}
        if self._truth is not None:
            record |= self._against_truth(self._truth)
        return record

    def _saturated(self, saturated: NDArray[np.bool_], ideal: Floats) -> NDArray[np.bool_]:
        """Mask of responses based on saturated readings (shape of their first three axes)."""
        if not self._leaves_out:
            return np.zeros(ideal.shape[:3], np.bool_)
        if not isinstance(self._detector, BlockDetector):
            return saturated
        last = saturated[:0] if self._last_saturated is None else self._last_saturated
        joined = np.concatenate((last, saturated))
        self._last_saturated = saturated[-1:]
        grid = self._detector.grid((saturated.shape[1], saturated.shape[2]))
        return np.asarray(block_share(joined[:-1] | joined[1:], grid) > SATURATED_SHARE)

    def _add_sums(
        self, reference: str, ideal: Floats, noisy: Floats, left_out: NDArray[np.bool_]
    ) -> None:
        if left_out.any():
            mask = left_out[..., np.newaxis] if ideal.ndim == 4 else left_out
            ideal = np.where(mask, np.nan, ideal)
        self._sums.setdefault(reference, []).append(error_sums(self._detector, ideal, noisy))

    def _against_truth(self, truth: BlockTruth) -> Record:
        left_out = np.concatenate(self._left_out)[..., None]
        known, pure = (
            np.where(left_out, np.nan, truths) for truths in (truth.velocities, truth.without_mixed)
        )
        velocities = {name: np.concatenate(chunks) for name, chunks in self._velocities.items()}
        ideal, counts = (
            truth_splits(velocities[name], known, truth.hidden) for name in ("ideal", "counts")
        )

        def errors(truth: Floats) -> Record:
            return {name: truth_error(flow, truth).to_dict() for name, flow in velocities.items()}

        return {
            "truth": errors(known),
            "truth_by_mixture": {"all": errors(known), "without_mixed": errors(pure)},
            "truth_splits": {
                name: {"ideal": ideal[name].to_dict(), "counts": counts[name].to_dict()}
                for name in ideal
            },
        }
