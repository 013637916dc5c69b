"""What is measured of a sequence, and against what."""

from typing import Annotated, Literal

from pydantic import Field

from megalopta.flow.benchmark import BenchmarkSettings
from megalopta.flow.stimuli import Normalization
from megalopta.record import Record

Reference = Literal["self", "perfect"]


class CalibrationFrames(Record, frozen=True):
    """The dark and flat frames that a sensor is calibrated with before its readings are corrected.

    They are drawn of the same device, with a seed of their own.
    """

    frames: Annotated[int, Field(ge=2, le=100_000)] = 256
    """Dark frames, and as many flat ones that half fill the pixel"""

    hot_times: Annotated[float, Field(gt=1)] = 10.0
    """A pixel is hot with more dark counts than so many times the median; neighbors replace it"""


class FlowSettings(Record, frozen=True):
    """What the responses to readings are compared with."""

    references: Annotated[tuple[Reference, ...], Field(min_length=1)] = ("self", "perfect")
    """self: the mean reading of the same device, whose noise the error then is. perfect: the
    photons on the pixels; the excess over self is what the device costs. self is always there."""

    saturated: Literal["score", "leave_out"] = "score"
    """Pixels that are full, and blocks with a tenth of them or more: scored like others, or left
    out; how many readings are full is in the record and in the report."""


class SequenceBenchmark(BenchmarkSettings, frozen=True):
    """The photon benchmark of a sequence."""

    both_normalizations: bool = False
    """Whether it is measured by the other normalization too, to show the effect; twice the work"""

    @property
    def measurements(self) -> tuple[BenchmarkSettings, ...]:
        """One, or by both normalizations; the chosen one is the first."""
        values = self.model_dump(exclude={"both_normalizations"})
        other: Normalization = "per_sequence" if self.normalization == "per_frame" else "per_frame"
        both = (self.normalization, other) if self.both_normalizations else (self.normalization,)
        return tuple(
            BenchmarkSettings.model_validate({**values, "normalization": each}) for each in both
        )
