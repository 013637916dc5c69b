"""The photon benchmark: how many photons per frame a detector needs (thesis, Chapter 4).

A clean sequence is resized, scaled to a photon flux, and drawn; each detector answers to the
counts and to the clean sequence, and the error between the two answers is followed over the flux.
Counts are multiplied by pixels/flux before the detectors see them, so that the answer to the clean
sequence does not depend on the flux (the dark counts it adds are the same everywhere; detectors
that notice such an offset get the clean sequence with it). All detectors see the same draws.

The sequence passes in chunks of frames, all fluxes of one chunk at a time, so memory does not grow
with its length. Every draw has a random stream of its own, so neither chunks nor the choice of
fluxes, sizes or detectors changes a number. Standard errors (`error_curve`) are estimated in blocks
of frames longer than the memory of the detector.

For a template that turns past a window, `photon_search` finds the thresholds alone with a fraction
of the draws.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np

from megalopta.flow.benchmark.result import BenchmarkResult
from megalopta.flow.benchmark.settings import BenchmarkSettings, checked_warm_up
from megalopta.flow.detectors import Detector, FloatArray, Frames, Method, method
from megalopta.flow.metrics import ErrorCurve, ErrorSums, Metric, combine, error_curve, error_sums
from megalopta.flow.stimuli import Counts, divisors, draw_counts, frame_light, resize, resized_shape

Progress = Callable[[int], object]
"""Called with the work done since the last call, in the units of `work_units`."""

Parts = Callable[[str, Callable[[], list[ErrorSums]]], list[ErrorSums]]
"""Gives a part of the work by its name: what was kept of it, or else what the callable returns."""


class Clip(Protocol):
    """A sequence of frames of which some can be had at a time: an array, in memory or on disk."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Frames, rows and columns."""

    def __getitem__(self, frames: slice, /) -> Any:
        """Return successive frames (n, H, W)."""


def photon_benchmark(
    frames: Clip,
    methods: Sequence[Method],
    settings: BenchmarkSettings,
    seed: int,
    sequence: str,
    on_progress: Progress | None = None,
    parts: Parts = lambda name, work: work(),
) -> BenchmarkResult:
    """Return the error of each method over the photon flux, and the fluxes it needs.

    Parameters
    ----------
    frames : (T, H, W)
        Clean sequence, any quantity proportional to the light; an array, or what is sliced like
        one, such as a Zarr array, of which a few frames are in memory at a time.
    methods
        Detectors, their names, or functions (`detector_from`); of different names.
    settings
    seed : int
        Any integer.
    sequence : str
        Name of the sequence; sequences of different names are drawn independently.
    on_progress
        Called with the work done since the last call; the total is `work_units`.
    parts
        Where parts of the work are kept, so that a run that was stopped goes on: one for each size
        and repeat, a sum of shape (fluxes, T) for each method.

    Raises
    ------
    ValueError
        When the frames are no light, too few or too small, or a size exceeds theirs.
    """
    detectors = [method(each) for each in methods]
    warm_up = checked_warm_up(frames.shape, detectors, settings)
    curves: list[ErrorCurve] = []
    for size in settings.sizes:
        stimulus = _Stimulus(frames, size, settings, seed, sequence)
        for detector, sums in zip(
            detectors, _measured(stimulus, detectors, settings, on_progress, parts), strict=True
        ):
            curves += [
                _curve(stimulus, detector, sums, metric, warm_up, settings)
                for metric in settings.metrics
            ]
    return BenchmarkResult(
        sequence=sequence,
        seed=seed,
        settings=settings,
        methods=tuple(detectors),
        frames=(frames.shape[0], frames.shape[1], frames.shape[2]),
        warm_up=warm_up,
        curves=tuple(curves),
    )


class _Stimulus:
    """A resized clean sequence, and the photons it gives."""

    def __init__(
        self, frames: Clip, size: int, settings: BenchmarkSettings, seed: int, sequence: str
    ) -> None:
        self._frames, self._settings, self.seed = frames, settings, seed
        rows, columns = frames.shape[1], frames.shape[2]
        self.shape = resized_shape((rows, columns), size)
        self.pixels = self.shape[0] * self.shape[1]
        # of a resized pixel, per frame
        self.dark_counts = settings.dark_counts * rows * columns / self.pixels
        # names the sequence at this size in random streams
        self.key = sequence, f"{self.shape[0]}x{self.shape[1]}"
        light = np.concatenate([frame_light(chunk) for _, chunk in self._resized()])
        self._divisors = divisors(light, settings.normalization)

    def chunks(self) -> Iterator[tuple[int, FloatArray]]:
        """Yield the number of the first frame and the frames, as shares of the flux."""
        for first, frames in self._resized():
            yield first, frames / self._divisors[first : first + len(frames), None, None]

    def counts(self, means: FloatArray, flux: float, repeat: int, first_frame: int) -> Counts:
        return draw_counts(
            means, self.seed, *self.key, f"{flux:.6g}", repeat, first_frame=first_frame
        )

    def _resized(self) -> Iterator[tuple[int, Frames]]:
        length = self._settings.chunk_frames
        for first in range(0, self._frames.shape[0], length):
            chunk = np.asarray(self._frames[first : first + length])
            yield first, resize(chunk, self.shape, self._settings.resize)


class _Comparison:
    """One detector at one flux: its answers to counts against those to the clean sequence."""

    def __init__(self, method: Detector, shape: tuple[int, int], has_own_ideal: bool) -> None:
        self.method = method
        self.answer_to_counts = method.start(shape)
        self.answer_to_means = method.start(shape) if has_own_ideal else None
        self.sums: list[ErrorSums] = []

    def add(self, ideal: FloatArray, means: FloatArray, counts: Counts, scale: float) -> None:
        if self.answer_to_means is not None:
            ideal = self.answer_to_means(means, scale)
        self.sums.append(error_sums(self.method, ideal, self.answer_to_counts(counts, scale)))


def _measured(
    stimulus: _Stimulus,
    methods: Sequence[Detector],
    settings: BenchmarkSettings,
    on_progress: Progress | None,
    parts: Parts,
) -> list[ErrorSums]:
    """Return the sums of each method, (fluxes, repeats, T)."""
    repeats = [
        parts(
            f"{stimulus.key[1]}-{repeat}",
            partial(_one_repeat, stimulus, methods, settings, repeat, on_progress),
        )
        for repeat in range(settings.repeats)
    ]
    return [
        combine(sums, lambda each: np.stack(each, axis=1)) for sums in zip(*repeats, strict=True)
    ]


def _one_repeat(
    stimulus: _Stimulus,
    methods: Sequence[Detector],
    settings: BenchmarkSettings,
    repeat: int,
    on_progress: Progress | None,
) -> list[ErrorSums]:
    """Return the sums of each method, (fluxes, T)."""
    answers_to_light = [method.start(stimulus.shape) for method in methods]
    comparisons = [
        [
            _Comparison(method, stimulus.shape, settings.compares_with_means(method))
            for method in methods
        ]
        for _ in settings.fluxes
    ]
    for first_frame, light in stimulus.chunks():
        ideals = [answer(light, stimulus.pixels) for answer in answers_to_light]
        for flux, at_flux in zip(settings.fluxes, comparisons, strict=True):
            means = light * flux + stimulus.dark_counts
            counts = stimulus.counts(means, flux, repeat, first_frame)
            for ideal, comparison in zip(ideals, at_flux, strict=True):
                comparison.add(ideal, means, counts, stimulus.pixels / flux)
            if on_progress is not None:
                on_progress(counts.size)
    return [
        combine([combine(each.sums, np.concatenate) for each in of_method], np.stack)
        for of_method in zip(*comparisons, strict=True)
    ]


def _curve(
    stimulus: _Stimulus,
    method: Detector,
    sums: ErrorSums,
    metric: Metric,
    warm_up: int,
    settings: BenchmarkSettings,
) -> ErrorCurve:
    scored = combine([sums], lambda parts: parts[0][..., warm_up:])
    frames = scored.scored.shape[-1]
    blocks = max(1, frames // (method.memory_frames + 1))
    return error_curve(
        method,
        stimulus.shape,
        metric,
        settings.fluxes,
        scored,
        [block * frames // blocks for block in range(blocks)],
        settings.bits,
        settings.confidence,
        stimulus.seed,
        *stimulus.key,
    )
