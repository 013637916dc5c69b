"""The photons that detectors need on a moving template, found with few draws.

Errors are measured at fluxes of a fixed lattice only, at those that a search asks for: it starts
where a single pixel is precise enough, strides up or down by half decades as far as the error
promises, and bisects the half decade in which the error crosses its level until its ends are
neighbors, or the curve between them is straight; while the interval of the crossing is open it
strides on. An error at a flux is the same number however the search
came there (`ShortSequences`), so no result depends on the other methods of a search, nor on the
order of searches. Of one method, metrics and bits share the fluxes that they were measured at, so
asking for more of them may refine an interval.

The crossing is the first downward one of the thesis if the error does not fall below its level and
rise again at a smaller flux; where it does, between lattice neighbors that a search has not seen,
another crossing may be found.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from megalopta.flow.benchmark.settings import SearchSettings
from megalopta.flow.benchmark.short_sequences import DetectorErrors, ShortSequences
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.registry import Method, method
from megalopta.flow.metrics.curve import ErrorCurve, error_curve
from megalopta.flow.metrics.response_error import ErrorSums, Metric, combine
from megalopta.flow.stimuli.moving_template import MovingTemplate

_MEAN_AT_TWO_BITS = 10.133
"""Count of a pixel whose relative error is 25 %; the error goes as its inverse root."""
_LONGEST_STRIDE_DECADES = 2.0
_STRIDES_PER_DECADE = 2
"""Detectors that stride alike measure on the same counts, which are drawn once."""
_STRAIGHT = 0.05
"""Decades by which an error may miss F^−½ between two fluxes before one between them is measured;
a bend of so much moves a threshold by 1 to 3 %"""
_EXACT_PER_DECADE = 100
"""Closed forms cost next to nothing, and deserve that interpolation adds no error of its own."""
_SMALLEST_ERROR = 1e-3
"""In levels; block matching reaches 0"""


def photon_search(
    stimulus: MovingTemplate,
    methods: Sequence[Method],
    settings: SearchSettings,
    seed: int,
    name: str,
) -> tuple[ErrorCurve, ...]:
    """Return a curve for each method and metric, measured where the thresholds need it.

    Parameters
    ----------
    stimulus
    methods
        Detectors, their names, or functions (`detector_from`); of different names.
    settings
    seed : int
        Any integer.
    name : str
        Of the stimulus; stimuli of different names are drawn independently.

    Raises
    ------
    ValueError
        When the frames are black or too small for a detector.
    """
    detectors = [method(each) for each in methods]
    sequences = ShortSequences(stimulus, settings, seed, name, detectors)
    # those that need most frames first: the others see some of these
    order = sorted(detectors, key=lambda detector: -detector.noise_memory_frames)
    curves = {each.name: _Search(sequences, each).curves() for each in order}
    return tuple(curve for each in detectors for curve in curves[each.name])


def next_index(
    errors: Mapping[int, float],
    level: float,
    last: int,
    per_decade: int,
    straight: float,
    is_smooth: bool = False,
) -> int | None:
    """Return where on a lattice of fluxes to measure next to find where an error crosses a level.

    Parameters
    ----------
    errors
        Index of a flux to the error there; at least one.
    level : float
    last : int
        Largest index, 1 or more.
    per_decade : int
        Fluxes per factor of ten.
    straight : float
        Decades by which the errors around the crossing may miss F^−½ and need no flux between them.
    is_smooth : bool
        Whether to interpolate where else the interval of the crossing is halved.

    Returns
    -------
    int, or None when the crossing is known closely enough or lies outside of the lattice.
    """
    depths = {index: _log_ratio(error, level) for index, error in errors.items()}
    lowest = min((index for index in errors if errors[index] < level), default=None)
    if lowest is None:
        highest = max(errors)
        following = min(highest + _stride(depths[highest], per_decade), last)
        return following if following > highest else None
    above = [index for index in errors if index < lowest]
    if not above:
        preceding = max(lowest - _stride(depths[lowest], per_decade), 0)
        return preceding if preceding < lowest else None
    highest = max(above)
    width, fall = lowest - highest, depths[highest] - depths[lowest]
    stride = _shortest_stride(per_decade)
    if width > stride or (is_smooth and width > 1):
        stride = 1 if width <= stride else stride
        between = highest + round(depths[highest] / fall * width / stride) * stride
        return min(max(between, highest + stride), lowest - stride)
    is_straight = abs(fall - 0.5 * width / per_decade) < straight
    return None if width == 1 or is_straight else highest + width // 2


class _Search:
    """The thresholds of one detector."""

    def __init__(self, sequences: ShortSequences, method: Detector) -> None:
        self._sequences, self._method = sequences, method
        self._comparison = DetectorErrors(sequences, method)
        self._is_exact = self._comparison.is_exact
        self._settings = (
            sequences.settings.model_copy(update={"fluxes_per_decade": _EXACT_PER_DECADE})
            if self._is_exact
            else sequences.settings
        )
        # the curve of a matcher may be flat, then steep, and yet fall as F^−½ on the whole
        bisects_always = self._is_exact or method.gives == "velocity"
        self._straight = 0.0 if bisects_always else _STRAIGHT
        self._fluxes = self._settings.fluxes
        self._last = len(self._fluxes) - 1
        self._measured: dict[int, ErrorSums] = {}
        self._made: dict[tuple[Metric, tuple[int, ...], int], ErrorCurve] = {}

    def curves(self) -> list[ErrorCurve]:
        """Return one curve for each metric."""
        if not self._comparison.is_defined:
            nothing = ErrorSums(*np.zeros((4, self._settings.repeats, self._settings.phases, 1)))
            self._measured = {0: nothing, self._last: nothing}
        else:
            for metric, bits in product(self._settings.metrics, self._settings.bits):
                self._measure(self._start(bits))
                self._bracket(metric, 2.0**-bits)
                self._close_interval(metric, bits)
        return [self._curve(metric, self._settings.bits) for metric in self._settings.metrics]

    def _measure(self, *indices: int) -> None:
        for index in indices:
            if index not in self._measured:
                self._measured[index] = self._comparison.errors(self._fluxes[index])

    def _start(self, bits: int) -> int:
        """Return the index where the brightness of a pixel is known to so many bits."""
        pixels = self._sequences.pixels
        needed = _MEAN_AT_TWO_BITS * 4.0 ** (bits - 2) * pixels
        dark = self._sequences.dark_counts * pixels
        flux = (needed + math.sqrt(needed**2 + 4 * needed * dark)) / 2  # F²/(F + dark) = needed
        decades = math.log10(flux / self._settings.flux_min)
        stride = _shortest_stride(self._settings.fluxes_per_decade)
        return min(max(round(decades * _STRIDES_PER_DECADE) * stride, 0), self._last)

    def _bracket(self, metric: Metric, level: float) -> None:
        while True:
            errors = {index: sums.of_sequence(metric) for index, sums in self._measured.items()}
            index = next_index(
                errors,
                level,
                self._last,
                self._settings.fluxes_per_decade,
                self._straight,
                is_smooth=self._is_exact,
            )
            if index is None:
                break
            self._measure(index)
        if len(self._measured) == 1:  # a curve has two points
            self._measure(0, self._last)

    def _close_interval(self, metric: Metric, bits: int) -> None:
        step = _shortest_stride(self._settings.fluxes_per_decade)
        while True:
            threshold = self._curve(metric, (bits,)).thresholds[bits]
            lowest, highest = min(self._measured), max(self._measured)
            if threshold.kind == "crossing" and threshold.low is None and lowest > 0:
                self._measure(max(lowest - step, 0))
            elif threshold.kind == "crossing" and threshold.high is None and highest < self._last:
                self._measure(min(highest + step, self._last))
            else:
                return

    def _curve(self, metric: Metric, bits: tuple[int, ...]) -> ErrorCurve:
        """Return the curve through what was measured, made again if that has become more."""
        key = metric, bits, len(self._measured)
        if key not in self._made:
            self._made[key] = self._new_curve(metric, bits)
        return self._made[key]

    def _new_curve(self, metric: Metric, bits: tuple[int, ...]) -> ErrorCurve:
        indices = sorted(self._measured)
        sums = combine([self._measured[index] for index in indices], np.stack)
        *rest, places, frames = sums.scored.shape
        flat = combine([sums], lambda parts: parts[0].reshape(*rest, places * frames))
        return error_curve(
            self._method,
            self._sequences.shape,
            metric,
            [self._fluxes[index] for index in indices],
            flat,
            range(0, places * frames, frames),
            bits,
            self._settings.confidence,
            self._sequences.seed,
            *self._sequences.key,
        )


def _log_ratio(error: float, level: float) -> float:
    return math.log10(max(error / level, _SMALLEST_ERROR))


def _stride(depth: float, per_decade: int) -> int:
    """Return how many fluxes away an error of 10^depth levels lets the crossing be expected.

    Errors fall as F^−½ above a detector's threshold and faster below it.
    """
    decades = min(1.5 * abs(depth), _LONGEST_STRIDE_DECADES)
    return max(1, math.ceil(decades * _STRIDES_PER_DECADE)) * _shortest_stride(per_decade)


def _shortest_stride(per_decade: int) -> int:
    return max(1, per_decade // _STRIDES_PER_DECADE)
