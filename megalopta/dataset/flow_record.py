"""What flow.json holds: the errors of one method on one sensor at one light level."""

from pydantic import BaseModel, FiniteFloat, NonNegativeInt

Number = FiniteFloat | None
"""None where it is undefined"""


class _Record(BaseModel, frozen=True, use_attribute_docstrings=True):
    pass


class ResponseErrors(_Record, frozen=True):
    """Of the responses to counts, against the noise-free ones, by both metrics."""

    literal: Number
    ratio: Number


class BlockErrors(_Record, frozen=True):
    """Of the velocities of blocks, against the true ones: the fields of `flow.TruthError`."""

    blocks: NonNegativeInt
    missing_fraction: Number
    endpoint_error_px: Number
    endpoint_error_median_px: Number
    angular_error_deg: Number
    bias_px: tuple[Number, Number]
    spread_px: tuple[Number, Number]
    relative_error_median: Number
    outlier_fraction: Number


class TruthErrors(_Record, frozen=True):
    """Of the noise-free velocities and of those from counts."""

    ideal: BlockErrors
    counts: BlockErrors
    corrected: BlockErrors | None = None
    """From corrected readings, where there are some"""


class SplitErrors(_Record, frozen=True):
    """By true speed, and by how much of a block is hidden in the next frame."""

    slow: TruthErrors
    medium: TruthErrors
    fast: TruthErrors
    clear: TruthErrors
    occlusion: TruthErrors


class MixtureErrors(_Record, frozen=True):
    """With the pixels that hold several things, and without."""

    all: TruthErrors
    without_mixed: TruthErrors


class RotationErrors(_Record, frozen=True):
    """Of the camera's yaw rate."""

    true_deg_s: FiniteFloat
    ideal_deg_s: Number
    counts_deg_s: Number


class FlowRecord(_Record, frozen=True):
    """The errors of one method; the file holds `model_dump(exclude_unset=True)`."""

    sensor: str
    level: float | str
    method: str
    warm_up_frames: NonNegativeInt
    saturated_fraction: FiniteFloat = 0.0
    """Of the readings"""

    error: ResponseErrors
    """Against the same device without noise"""

    error_perfect: ResponseErrors | None = None
    """Against a sensor that loses and adds nothing: the noise's error and the device's"""

    error_corrected: ResponseErrors | None = None
    """Of the responses to corrected readings, against the same"""

    truth: TruthErrors | None = None
    """Of methods that give velocities"""

    truth_by_mixture: MixtureErrors | None = None
    """However the configuration has mixed pixels counted"""

    truth_splits: SplitErrors | None = None
    rotation: RotationErrors | None = None
    """Of methods that tell directions, where the camera turns"""
