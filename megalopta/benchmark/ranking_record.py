"""What ranking.json holds, read back by the class that wrote it."""

from collections.abc import Mapping
from functools import cached_property

from pydantic import FiniteFloat, NonNegativeInt, PositiveFloat, PositiveInt

from megalopta.benchmark.ranking_settings import Pooling, RankingSettings
from megalopta.core.format_numbers import written
from megalopta.core.record import Record

BOUND = "Poisson bound"

Number = FiniteFloat | None
"""None where it is undefined"""


class _Case(Record, frozen=True):
    pixels: int
    """Side of the squares of pixels that are pooled."""
    frames: int
    """Frames that are pooled."""
    photons_per_frame: PositiveFloat

    @property
    def pooling(self) -> Pooling:
        """What is pooled."""
        return Pooling(self.pixels, self.frames)


class MeanError(_Case, frozen=True):
    """Mean endpoint error (px of the full image per frame), and what holds it in 95 % of cases."""

    group: str
    method: str
    """A method, "answer 0", or the Poisson bound."""
    mean: FiniteFloat
    low: Number
    high: Number


class BestMethod(_Case, frozen=True):
    """The method with the lowest mean error."""

    group: str
    method: str
    is_sure: bool
    """Whether the interval of every other method's ratio to it lies above 1."""


class Order(Record, frozen=True):
    """Two methods in a group, without pooling: the worse one's mean error over the better one's."""

    photons_per_frame: PositiveFloat
    group: str
    better: str
    worse: str
    ratio: FiniteFloat
    low: FiniteFloat
    high: FiniteFloat
    """Holds the ratio in 95 % of cases, from `low` on."""
    p: FiniteFloat
    """Two-sided p-value of the ratio being 1."""


class Consistency(_Case, frozen=True):
    """Error against the same method's answer to the light (Eq. 4.5), median of the sequences."""

    method: str
    error: Number


class CameraMotionError(Record, frozen=True):
    """Of the camera's motion, without pooling, medians over pairs of frames."""

    photons_per_frame: PositiveFloat
    method: str
    rotation_deg: Number
    heading_deg: Number


class YawRateError(Record, frozen=True):
    """Of the camera's yaw rate from a weighted sum of all answers, medians over sequences."""

    photons_per_frame: PositiveFloat
    method: str
    true_deg_s: FiniteFloat
    """Root mean square of the true rate."""
    ideal_deg_s: FiniteFloat
    """Root mean square error on light without noise."""
    counts_deg_s: FiniteFloat
    """Root mean square error on photons."""


class Ranking(Record, frozen=True):
    """What was measured, over all sequences."""

    format: NonNegativeInt = written("ranking")
    """Of this file (`format_numbers`)"""
    settings: RankingSettings
    sequences: tuple[str, ...]
    frames: PositiveInt
    """Of all of them."""
    photons_per_lux_s: FiniteFloat
    """Photons of a frame on perfect pixels for each lux and second."""
    blocks: Mapping[str, NonNegativeInt]
    """Blocks of each group without pooling, over all pairs of frames."""
    errors: tuple[MeanError, ...]
    best: tuple[BestMethod, ...]
    orders: tuple[Order, ...]
    """Of all pairs of methods in groups that are compared, such as rotation alone and parallax."""
    consistency: tuple[Consistency, ...]
    camera: tuple[CameraMotionError, ...]
    yaw_rates: tuple[YawRateError, ...]

    def error_of(self, pooling: Pooling, flux: float, group: str, method: str) -> MeanError | None:
        """Return the mean error of a method; None where the group has no blocks."""
        return self._errors.get((pooling, flux, group, method))

    def best_of(self, pooling: Pooling, flux: float, group: str) -> BestMethod | None:
        """Return the best method; None where the group has no blocks."""
        return self._best.get((pooling, flux, group))

    def order_of(self, flux: float, group: str, one: str, other: str) -> Order | None:
        """Return which of two methods is better; None where it cannot be told at all."""
        return self._orders.get((flux, group, frozenset((one, other))))

    @cached_property
    def _errors(self) -> Mapping[tuple[Pooling, float, str, str], MeanError]:
        return {
            (each.pooling, each.photons_per_frame, each.group, each.method): each
            for each in self.errors
        }

    @cached_property
    def _best(self) -> Mapping[tuple[Pooling, float, str], BestMethod]:
        return {(each.pooling, each.photons_per_frame, each.group): each for each in self.best}

    @cached_property
    def _orders(self) -> Mapping[tuple[float, str, frozenset[str]], Order]:
        return {
            (each.photons_per_frame, each.group, frozenset((each.better, each.worse))): each
            for each in self.orders
        }
