"""The photon benchmark: how many photons per frame a detector needs (dissertation, Chapter 4).

A clean sequence is resized, scaled to a photon flux, and drawn. Each detector runs on the counts
and on the clean sequence, and the error between both responses is measured over the flux. Counts
are multiplied by pixels/flux first, so that the response to the clean sequence does not depend on
the flux (dark counts are the same everywhere; detectors that respond to such an offset get the
clean sequence with it). All detectors see the same draws.

The sequence is processed in chunks of frames, all fluxes of a chunk at a time, so memory does not
grow with its length. Every draw has its own random stream, so neither chunks nor the choice of
fluxes, sizes or detectors changes a number. Standard errors (`error_curve`) are estimated in blocks
of frames longer than the memory of the detector.

For a template that turns past a window, `photon_search` finds the thresholds alone with a fraction
of the draws.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, Self

import numpy as np
from pydantic import PositiveInt, TypeAdapter

from megalopta.core.arrays import Floats
from megalopta.flow.benchmark.settings import BenchmarkSettings, checked_warm_up
from megalopta.flow.detectors.base import Detector, Frames
from megalopta.flow.detectors.registry import METHODS, Method, method
from megalopta.flow.metrics.photon_threshold import ErrorCurve, error_curve, measured_errors
from megalopta.flow.metrics.response_error import Metric, error_sums
from megalopta.flow.stimuli.photons import Counts, divisors, draw_counts, frame_light
from megalopta.flow.stimuli.resizing import resize, resized_shape


@dataclass(frozen=True)
class Bookkeeping:
    """Progress of a run, and cache of its parts, so that an interrupted run can continue."""

    on_progress: Callable[[int], object] = lambda work: None
    """Called with the work done since the last call, in the units of `work_units`."""
    part: Callable[[str, Callable[[], list[Floats]]], list[Floats]] = lambda _, work: work()
    """Returns a part by name, one per size and repeat: the cached one, or else the result of the
    callable, sums (4, fluxes, T) of each method."""


class Clip(Protocol):
    """A sequence of frames, of which some are read at a time: an array, in memory or on disk."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Frames, rows and columns."""

    def __getitem__(self, frames: slice, /) -> Any:
        """Return successive frames (n, H, W)."""


@dataclass(frozen=True)
class BenchmarkResult:
    """All curves of one sequence, with everything needed to reproduce them."""

    sequence: str
    seed: int
    settings: BenchmarkSettings
    methods: tuple[Detector, ...]
    frames: tuple[PositiveInt, PositiveInt, PositiveInt]
    """Shape (T, H, W) of the clean sequence before resizing"""
    warm_up: int
    """Frames at the start that were not scored"""
    curves: tuple[ErrorCurve, ...]

    def curve(self, method: str, size: int, metric: Metric = "literal") -> ErrorCurve:
        """Return the curve of one detector at one frame size (rows).

        Raises ValueError if it was not measured.
        """
        for curve in self.curves:
            if (curve.method, curve.shape[0], curve.metric) == (method, size, metric):
                return curve
        raise ValueError(
            f"no {metric} curve of {method!r} at {size} px: choose from"
            f" {', '.join(each.name for each in self.methods)} at {self.settings.sizes} px,"
            f" {', '.join(self.settings.metrics)}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return all fields, ready for JSON."""
        return vars(self) | {
            "settings": self.settings.model_dump(mode="json"),
            "methods": {each.name: each.model_dump(mode="json") for each in self.methods},
            "curves": [curve.to_dict() for curve in self.curves],
        }

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Self:
        """Return the result that `to_dict` wrote; raises as `ErrorCurve.from_dict` does."""
        methods = (
            type(METHODS[name]).model_validate(own) for name, own in fields["methods"].items()
        )
        curves = tuple(ErrorCurve.from_dict(each) for each in fields["curves"])
        return TypeAdapter(cls).validate_python(
            {**fields, "methods": (*methods,), "curves": curves}
        )


def photon_benchmark(
    frames: Clip,
    methods: Sequence[Method],
    settings: BenchmarkSettings,
    seed: int,
    sequence: str,
    books: Bookkeeping = Bookkeeping(),
) -> BenchmarkResult:
    """Return the error of each method over the photon flux, and the fluxes that it needs.

    Raises ValueError if the frames are not light, too few or too small, or a size exceeds theirs.

    Parameters
    ----------
    frames : (T, H, W)
        Clean sequence, any quantity proportional to the light; an array, or an object sliced
        like one, such as a Zarr array, of which a few frames are in memory at a time.
    methods
        Detectors, their names, or functions (`detector_from`); of different names.
    seed : int
        Any integer.
    sequence : str
        Name of the sequence; sequences of different names are drawn independently.
    books
        Gets the work done, `work_units` in all, and caches its parts.
    """
    detectors = [method(each) for each in methods]
    warm_up = checked_warm_up(frames.shape, detectors, settings)
    curves: list[ErrorCurve] = []
    for size in settings.sizes:
        at_size = _AtSize(frames, size, settings, seed, sequence)
        for detector, sums in zip(detectors, at_size.measured(detectors, books), strict=True):
            curves += [at_size.curve(detector, sums, each, warm_up) for each in settings.metrics]
    return BenchmarkResult(
        sequence=sequence,
        seed=seed,
        settings=settings,
        methods=tuple(detectors),
        frames=(frames.shape[0], frames.shape[1], frames.shape[2]),
        warm_up=warm_up,
        curves=tuple(curves),
    )


class _AtSize:
    """A resized clean sequence, and the errors of methods on its photons."""

    def __init__(
        self, frames: Clip, size: int, settings: BenchmarkSettings, seed: int, sequence: str
    ) -> None:
        self._frames, self._settings = frames, settings
        rows, columns = frames.shape[1], frames.shape[2]
        self._shape = resized_shape((rows, columns), size)
        self._pixels = self._shape[0] * self._shape[1]
        # per resized pixel and frame
        self._dark_counts = settings.dark_counts * rows * columns / self._pixels
        # names the sequence at this size in random streams
        self._key = seed, sequence, f"{self._shape[0]}x{self._shape[1]}"
        self._of_means: dict[tuple[str, float, int], Floats] = {}
        """Velocities in mean counts by method, scale and first frame: the same in every repeat"""
        light = np.concatenate([frame_light(chunk) for _, chunk in self._resized()])
        self._divisors = divisors(light, settings.normalization)

    def measured(self, methods: Sequence[Detector], books: Bookkeeping) -> list[Floats]:
        """Return the sums of each method, (4, fluxes, repeats, T)."""
        repeats = [
            books.part(f"{self._key[-1]}-{each}", partial(self._repeat, each, methods, books))
            for each in range(self._settings.repeats)
        ]
        return [np.stack(sums, axis=2) for sums in zip(*repeats, strict=True)]

    def _repeat(self, repeat: int, methods: Sequence[Detector], books: Bookkeeping) -> list[Floats]:
        """Return the sums of each method, (4, fluxes, T)."""
        fluxes, shape = self._settings.fluxes, self._shape
        to_light = [method.start(shape) for method in methods]
        comparisons = [[self._comparison(each) for each in methods] for _ in fluxes]
        sums: defaultdict[tuple[str, float], list[Floats]] = defaultdict(list)
        for first, frames in self._resized():
            light = frames / self._divisors[first : first + len(frames), None, None]
            ideals = [respond(light, self._pixels) for respond in to_light]
            # bright light first, which takes longest: the time left then only falls
            for flux, at_flux in zip(reversed(fluxes), reversed(comparisons), strict=True):
                means = light * flux + self._dark_counts
                key = *self._key, f"{flux:.6g}", repeat
                counts = draw_counts(means, *key, first_frame=first)
                for each, ideal, errors in zip(methods, ideals, at_flux, strict=True):
                    found = errors(ideal, means, counts, self._pixels / flux, first)
                    sums[each.name, flux].append(found)
                books.on_progress(counts.size)
        return [
            np.stack([np.concatenate(sums[each.name, flux], axis=1) for flux in fluxes], axis=1)
            for each in methods
        ]

    def _comparison(
        self, method: Detector
    ) -> Callable[[Floats, Floats, Counts, float, int], Floats]:
        """Return a function that gives the errors of a detector at one flux, chunk by chunk."""
        to_counts, to_means = method.start(self._shape), method.start(self._shape)
        has_own = self._settings.compares_with_means(method)

        def errors(
            ideal: Floats, means: Floats, counts: Counts, scale: float, first: int
        ) -> Floats:
            reference = self._of_means.get((method.name, scale, first)) if has_own else ideal
            if reference is None:
                reference = to_means(means, scale)
                if method.gives == "velocity":  # a few numbers a block; responses are frames
                    self._of_means[method.name, scale, first] = reference
            return error_sums(method, reference, to_counts(counts, scale))

        return errors

    def curve(self, method: Detector, sums: Floats, metric: Metric, warm_up: int) -> ErrorCurve:
        """Return the curve of a method, with standard errors of blocks longer than its memory."""
        frames = sums.shape[-1] - warm_up
        blocks = max(1, frames // (method.memory_frames + 1))
        starts = [block * frames // blocks for block in range(blocks)]
        measured = measured_errors(metric, self._settings.fluxes, sums[..., warm_up:], starts)
        asked = dict.fromkeys(self._settings.bits, self._settings.confidence)
        return error_curve(method, self._shape, metric, measured, asked, self._key)

    def _resized(self) -> Iterator[tuple[int, Frames]]:
        length = self._settings.chunk_frames
        for first in range(0, self._frames.shape[0], length):
            chunk = np.asarray(self._frames[first : first + length])
            yield first, resize(chunk, self._shape, self._settings.resize)
