"""Content of flow.json: errors of one method on one sensor at one light level."""

import math
from typing import Literal

from pydantic import BaseModel, FiniteFloat, NonNegativeInt

Number = FiniteFloat | None
"""None if undefined"""


class _Record(BaseModel, frozen=True, use_attribute_docstrings=True):
    pass


class ResponseErrors(_Record, frozen=True):
    """Errors of the responses to counts against noise-free ones, by both metrics."""

    literal: Number
    ratio: Number


class BlockErrors(_Record, frozen=True):
    """Errors of block velocities against the true ones: the fields of `flow.TruthError`."""

    blocks: NonNegativeInt
    missing_fraction: Number
    endpoint_error_px: Number
    endpoint_error_median_px: Number
    angular_error_deg: Number
    bias_px: tuple[Number, Number]
    spread_px: tuple[Number, Number]
    relative_error_median: Number
    relative_error_interval: tuple[Number, Number] = (None, None)
    outlier_fraction: Number


class TruthErrors(_Record, frozen=True):
    """Errors of noise-free velocities and of those from counts."""

    ideal: BlockErrors
    counts: BlockErrors
    corrected: BlockErrors | None = None
    """Errors from corrected readings, if there are any"""


class FlowRecord(_Record, frozen=True):
    """The errors of one method; the file holds `model_dump(exclude_unset=True)`."""

    sensor: str
    level: float | str
    method: str
    warm_up_frames: NonNegativeInt
    saturated_fraction: FiniteFloat = 0.0
    """Share of saturated readings"""
    error: ResponseErrors
    """Error against the same device without noise"""
    error_perfect: ResponseErrors | None = None
    """Error against a perfect sensor: that of noise and of the device"""
    error_corrected: ResponseErrors | None = None
    """Error of the responses to corrected readings, against a perfect sensor"""
    truth: TruthErrors | None = None
    """Errors of methods that give velocities"""
    truth_by_mixture: dict[Literal["all", "without_mixed"], TruthErrors] = {}
    """Errors with mixed pixels, as in `truth`, and without them"""
    truth_splits: dict[Literal["slow", "medium", "fast", "clear", "occlusion"], TruthErrors] = {}
    """Errors by true speed, and by the hidden share of a block"""

    @property
    def median_error(self) -> float:
        """Median error of blocks relative to the true velocity; infinite if unknown."""
        error = self.truth.counts.relative_error_median if self.truth else None
        return math.inf if error is None else error
