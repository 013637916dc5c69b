"""What is measured of a sequence, and against what."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.core.record import Record
from megalopta.flow.benchmark.settings import BenchmarkSettings
from megalopta.flow.stimuli.photons import Normalization

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

    mixed: Literal["score", "leave_out", "weigh"] = "score"
    """Pixels that hold several things, in the true velocity of a block: score counts all pixels
    alike, each with the flow of its center; leave_out only those that are least_purity pure or
    more; weigh each by its purity, the share that its flow is true of. Blocks of which less than
    half is left have no true velocity. The record and the report give all pixels, and without the
    mixed ones, in any case."""

    least_purity: Annotated[float, Field(gt=0, le=1)] = 0.75
    """Share of a pixel that its center's object has to fill for the pixel not to be mixed."""

    def is_pure(self, purity: NDArray[np.floating]) -> NDArray[np.float64]:
        """1 where pixels of a purity are not mixed, else 0."""
        return np.asarray(purity >= self.least_purity, np.float64)

    def weights(self, purity: NDArray[np.floating]) -> NDArray[np.floating] | None:
        """How much pixels of a purity, 0 to 1, count; None: all alike."""
        if self.mixed == "leave_out":
            return self.is_pure(purity)
        return purity if self.mixed == "weigh" else None


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
