"""Settings of the measurements on a sequence and their references, of label maps and tracks."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from megalopta.core.record import Record
from megalopta.flow.benchmark import BenchmarkSettings, each_once
from megalopta.flow.stimuli.photons import Normalization
from megalopta.scenes import Camera

Reference = Literal["self", "perfect"]
ONCE = AfterValidator(each_once)
"""Refuses duplicates among the values of a field"""


class CalibrationFrames(Record, frozen=True):
    """Dark and flat frames that calibrate a sensor before its readings are corrected.

    They are drawn from the same device, with a seed of their own.
    """

    frames: Annotated[int, Field(ge=2, le=100_000)] = 256
    """Number of dark frames, and of flat frames, which fill the pixel to half of its capacity"""

    hot_times: Annotated[float, Field(gt=1)] = 10.0
    """Dark counts of a hot pixel, in multiples of the median; its neighbors replace it"""


class FlowSettings(Record, frozen=True):
    """References and masks of the responses to readings."""

    references: Annotated[tuple[Reference, ...], Field(min_length=1)] = ("self", "perfect")
    """self: the mean reading of the same device; the error is its noise. perfect: the photons on
    the pixels; the error also includes the losses of the device. self is always included."""

    saturated: Literal["score", "leave_out"] = "score"
    """Count saturated pixels, and blocks of which a tenth or more is saturated, in the errors
    (score), or not (leave_out). Record and report give the share of saturated readings."""

    mixed: Literal["score", "leave_out", "weigh"] = "score"
    """Pixels that see several objects, in a block's true velocity. score: all pixels count alike,
    with the flow of their centers. leave_out: only pixels of least_purity or more. weigh: pixels
    count in proportion to their purity. Blocks with less than half of their pixels left have no
    true velocity. Record and report always give the errors with and without mixed pixels."""

    least_purity: Annotated[float, Field(gt=0, le=1)] = 0.75
    """Purity, the share that the object at a pixel's center fills, below which a pixel is mixed."""

    def is_pure(self, purity: NDArray[np.floating]) -> NDArray[np.float64]:
        """1 where pixels of a purity are not mixed, else 0."""
        return np.asarray(purity >= self.least_purity, np.float64)

    def weights(self, purity: NDArray[np.floating]) -> NDArray[np.floating] | None:
        """Weight of pixels by their purity, 0 to 1; None: equal weights."""
        if self.mixed == "leave_out":
            return self.is_pure(purity)
        return purity if self.mixed == "weigh" else None


class SequenceBenchmark(BenchmarkSettings, frozen=True):
    """Photon benchmark of a sequence."""

    both_normalizations: bool = False
    """Measure with the other normalization too, to show its effect; doubles the work"""

    @property
    def measurements(self) -> tuple[BenchmarkSettings, ...]:
        """Settings of one or both normalizations, the chosen one first."""
        values = self.model_dump(exclude={"both_normalizations"})
        other: Normalization = "per_sequence" if self.normalization == "per_frame" else "per_frame"
        both = (self.normalization, other) if self.both_normalizations else (self.normalization,)
        return tuple(
            BenchmarkSettings.model_validate({**values, "normalization": each}) for each in both
        )


LabelName = Literal["classes", "instances", "clusters", "normals", "albedo"]


class TrackSettings(Record, frozen=True):
    """Points to follow through all frames: a grid of pixel centers of some frames."""

    spacing_px: Annotated[int, Field(ge=1)] = 8
    """Distance between neighboring points (px)."""

    frames: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)] = (0,)
    """Frames, from 0, in which the points are seen."""

    def points(self, camera: Camera) -> NDArray[np.float64]:
        """Image coordinates (N, 2) of the points, px, row by row."""
        first, step = self.spacing_px // 2, self.spacing_px
        return camera.pixel_centers()[first::step, first::step].reshape(-1, 2)
