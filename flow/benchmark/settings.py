"""Settings of photon benchmarks, and their computational work."""

import math
from collections import Counter
from collections.abc import Sequence
from itertools import product
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, Field, field_validator, model_validator

from megalopta.flow.detectors.base import Detector
from megalopta.flow.metrics.response_error import METRICS, Metric
from megalopta.flow.stimuli.photons import Normalization
from megalopta.flow.stimuli.resizing import ResizeKind, resized_shape

_THESIS_WARM_UP = 30


class CurveSettings(
    BaseModel, frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
):
    """Error curves to measure, and their precision."""

    flux_min: Annotated[float, Field(ge=1e-6, le=1e15)] = 1e3
    """Smallest flux (photons per frame)"""
    flux_max: Annotated[float, Field(gt=0, le=1e15)] = 1e12
    """Largest flux (photons per frame)"""
    fluxes_per_decade: Annotated[int, Field(ge=1, le=1000)] = 2
    """Number of fluxes per factor of ten"""
    repeats: Annotated[int, Field(ge=2, le=100_000)] = 4
    """Independent draws of the whole sequence at each flux; they give the confidence intervals"""
    dark_counts: Annotated[float, Field(ge=0, le=1e12)] = 0.1
    """Dark counts per frame and pixel of the frames before resizing"""
    normalization: Normalization = "per_frame"
    """per_frame scales every frame to the flux, as in the dissertation. per_sequence scales the
    mean frame, so that frames keep their differences in brightness"""
    reference: Literal["self", "perfect"] = "self"
    """Reference of the responses to counts: those to the mean counts, dark counts included (self),
    or to the light alone (perfect). It matters to IM and PM, which respond to an offset"""
    metrics: Annotated[tuple[Metric, ...], Field(min_length=1)] = METRICS
    """Error metrics: "literal" is Eq. 4.5, "ratio" does not divide by near-zero responses"""
    bits: Annotated[tuple[Annotated[int, Field(ge=1, le=16)], ...], Field(min_length=1)] = (2, 3, 4)
    """Accuracies whose flux is reported; n bits are an error of 2⁻ⁿ"""
    confidence: Annotated[float, Field(gt=0, lt=1)] = 0.95
    """Confidence level of intervals"""

    def compares_with_means(self, detector: Detector) -> bool:
        """True if the reference of a detector's responses includes mean dark counts."""
        return self.reference == "self" and not detector.ignores_offset

    @field_validator("metrics", "bits", "sizes", check_fields=False)
    @classmethod
    def _each_once(cls, values: tuple[Any, ...]) -> tuple[Any, ...]:
        return each_once(values)

    @model_validator(mode="after")
    def _two_fluxes(self) -> Self:
        if len(self.fluxes) < 2:
            raise ValueError(
                f"flux_min {self.flux_min:g} to flux_max {self.flux_max:g} at"
                f" {self.fluxes_per_decade} per decade holds fewer than two fluxes; widen the range"
            )
        return self

    @property
    def fluxes(self) -> tuple[float, ...]:
        """Photons per frame, in equal factors from the smallest up to the largest."""
        decades = math.log10(self.flux_max / self.flux_min)
        steps = math.floor(decades * self.fluxes_per_decade + 1e-9)
        return tuple(
            self.flux_min * 10 ** (step / self.fluxes_per_decade) for step in range(steps + 1)
        )


class BenchmarkSettings(CurveSettings, frozen=True):
    """Measurements on a sequence, and their precision."""

    sizes: Annotated[tuple[Annotated[int, Field(ge=3)], ...], Field(min_length=1)] = (
        60, 120, 180, 240,
    )  # fmt: skip
    """Rows of the resized frames (px); columns are in proportion"""
    resize: ResizeKind = "nearest"
    """"nearest" subsamples frames as in the dissertation, "area" pools the light"""
    warm_up: Annotated[int, Field(ge=0)] | None = None
    """Frames not scored at the start; default: 30 if there are 60, else a detector's memory"""
    chunk_frames: Annotated[int, Field(ge=1, le=10_000)] = 16
    """Frames processed together; changes memory and speed, never a result"""


class SearchSettings(CurveSettings, frozen=True):
    """Measurements on a rotating template, and their precision."""

    repeats: Annotated[int, Field(ge=2, le=100_000)] = 2
    """Independent draws of all frames at each flux; they give the confidence intervals"""
    fluxes_per_decade: Annotated[int, Field(ge=1, le=1000)] = 8
    """Fluxes per factor of ten; only those that the thresholds need are measured"""
    phases: Annotated[int, Field(ge=1, le=251)] = 4
    """Places around the template at which short sequences start; errors are means over them"""
    frames: Annotated[int, Field(ge=1, le=10_000)] = 6
    """Scored frames of each of these sequences, after those in which the filters settle"""
    summed_frames: Annotated[int, Field(ge=1, le=10_000)] = 1
    """Temporal pooling: detectors see the sliding sum of this many frames"""


def each_once(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the values, or refuse duplicates."""
    for value, times in Counter(values).items():
        if times > 1:
            raise ValueError(f"{value} is named twice: name each once")
    return values


def work_units(frames_shape: tuple[int, ...], settings: BenchmarkSettings) -> int:
    """Return the work of a benchmark of frames (T, H, W): the number of drawn pixels."""
    shapes = (resized_shape((frames_shape[1], frames_shape[2]), size) for size in settings.sizes)
    pixels = sum(rows * columns for rows, columns in shapes)
    return frames_shape[0] * pixels * len(settings.fluxes) * settings.repeats


def default_warm_up(n_frames: int, methods: Sequence[Detector]) -> int:
    """Return the number of frames not to score at the start of a sequence.

    The dissertation's 30 if the sequence has at least 60; in a shorter one the smallest number
    after which the slowest filter of these methods has decayed to 1 %.
    """
    if n_frames >= 2 * _THESIS_WARM_UP:
        return _THESIS_WARM_UP
    return max(method.memory_frames for method in methods)


def checked_warm_up(
    frames_shape: tuple[int, ...], methods: Sequence[Detector], settings: BenchmarkSettings
) -> int:
    """Return the number of frames not to score, after checking that a benchmark is possible.

    `frames_shape`: (T, H, W) of the clean sequence; `methods`: detectors of different names.

    Raises ValueError if frames are too few or too small, or a size exceeds theirs.
    """
    names = [method.name for method in methods]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"methods {names}: give at least one, each under a name of its own")
    for size, method in product(settings.sizes, methods):
        method.start(resized_shape((frames_shape[1], frames_shape[2]), size))
    warm_up = settings.warm_up
    if warm_up is None:
        warm_up = default_warm_up(frames_shape[0], methods)
    if frames_shape[0] - warm_up < 2:
        raise ValueError(
            f"{frames_shape[0]} frames leave fewer than two to score after a warm_up of {warm_up}:"
            " give more frames or a shorter warm_up"
        )
    return warm_up
