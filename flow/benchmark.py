"""The photon benchmark: how many photons per frame a detector needs (dissertation, Chapter 4).

A clean sequence is resized, scaled to a photon flux, and drawn. Each detector runs on the counts
and on the clean sequence, and the error between both responses is measured over the flux. Counts
are multiplied by pixels/flux first, so that the response to the clean sequence does not depend on
the flux. Detectors that respond to an offset get the clean sequence with dark counts.

All fluxes of a few frames are measured at a time. Every draw has its own random stream, so neither
chunks nor the choice of fluxes, sizes or detectors changes a number.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, Field, PositiveInt, TypeAdapter, field_validator, model_validator

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Detector, Frames
from megalopta.flow.detectors.registry import METHODS, Method, method
from megalopta.flow.metrics.photon_threshold import ErrorCurve, error_curve
from megalopta.flow.metrics.response_error import METRICS, Metric, error_sums
from megalopta.flow.stimuli import photons

_THESIS_WARM_UP = 30
CHUNK_FRAMES = 16


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
    metrics: Annotated[tuple[Metric, ...], Field(min_length=1)] = METRICS
    """Error metrics: "literal" is Eq. 4.5, "ratio" does not divide by near-zero responses"""
    bits: Annotated[tuple[Annotated[int, Field(ge=1, le=16)], ...], Field(min_length=1)] = (2, 3, 4)
    """Accuracies whose flux is reported; n bits are an error of 2⁻ⁿ"""

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
    resize: photons.ResizeKind = "nearest"
    """"nearest" subsamples frames as in the dissertation, "area" pools the light"""
    warm_up: Annotated[int, Field(ge=0)] | None = None
    """Frames not scored at the start; default: 30 if there are 60, else a detector's memory"""


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
    shapes = (
        photons.resized_shape((frames_shape[1], frames_shape[2]), size) for size in settings.sizes
    )
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
    for size, detector in product(settings.sizes, methods):
        detector.start(photons.resized_shape((frames_shape[1], frames_shape[2]), size))
    warm_up = settings.warm_up
    if warm_up is None:
        warm_up = default_warm_up(frames_shape[0], methods)
    if frames_shape[0] - warm_up < 2:
        raise ValueError(
            f"{frames_shape[0]} frames leave fewer than two to score after a warm_up of {warm_up}:"
            " give more frames or a shorter warm_up"
        )
    return warm_up


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
        names = ", ".join(detector.name for detector in self.methods)
        sizes = f"{names} at {self.settings.sizes} px"
        raise ValueError(f"no {metric} curve of {method!r} at {size} px: choose from {sizes}")

    def to_dict(self) -> dict[str, Any]:
        """Return all fields, ready for JSON."""
        return vars(self) | {
            "settings": self.settings.model_dump(mode="json"),
            "methods": {
                detector.name: detector.model_dump(mode="json") for detector in self.methods
            },
            "curves": [curve.to_dict() for curve in self.curves],
        }

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Self:
        """Return the result that `to_dict` wrote; raises as `ErrorCurve.from_dict` does."""
        methods = (
            type(METHODS[name]).model_validate(parameters)
            for name, parameters in fields["methods"].items()
        )
        curves = tuple(ErrorCurve.from_dict(curve) for curve in fields["curves"])
        return TypeAdapter(cls).validate_python(
            {**fields, "methods": (*methods,), "curves": curves}
        )


def photon_benchmark(
    frames: Frames,
    methods: Sequence[Method],
    settings: BenchmarkSettings,
    seed: int,
    sequence: str,
    advance: Callable[[int], object] | None = None,
    cached: Callable[[str, Callable[[], list[Floats]]], list[Floats]] | None = None,
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
    seed, sequence
        Sequences of different names are drawn independently.
    advance
        Called with the work done since the last call, `work_units` in all.
    cached
        Returns a part of the work by name, one per size and repeat: a stored one, or else the
        result of the callable, sums (4, fluxes, T) of each method.
    """
    detectors = [method(chosen) for chosen in methods]
    warm_up = checked_warm_up(frames.shape, detectors, settings)
    curves: list[ErrorCurve] = []
    for size in settings.sizes:
        at_size = _AtSize(frames, size, settings, seed, sequence)
        repeats = []
        for n in range(settings.repeats):
            work = partial(at_size.sums, n, detectors, advance)
            repeats.append(cached(f"{at_size.key[-1]}-{n}", work) if cached else work())
        for detector, repeated in zip(detectors, zip(*repeats, strict=True), strict=True):
            sums = np.stack(repeated, axis=2)[..., warm_up:]
            # independent blocks of frames are longer than the detector's memory
            scored = sums.shape[-1]
            blocks = max(1, scored // (detector.memory_frames + 1))
            starts = [block * scored // blocks for block in range(blocks)]
            for metric in settings.metrics:
                of_sums = settings.fluxes, sums, starts, settings.bits, at_size.key
                curves.append(error_curve(detector, at_size.shape, metric, *of_sums))
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
        self, frames: Frames, size: int, settings: BenchmarkSettings, seed: int, sequence: str
    ) -> None:
        self._frames, self._settings = frames, settings
        rows, columns = frames.shape[1], frames.shape[2]
        self.shape = photons.resized_shape((rows, columns), size)
        self._pixels = self.shape[0] * self.shape[1]
        # per resized pixel and frame
        self._dark_counts = settings.dark_counts * rows * columns / self._pixels
        self.key = seed, sequence, f"{self.shape[0]}x{self.shape[1]}"
        """Names the sequence at this size in random streams"""
        self._of_means: dict[tuple[str, float, int], Floats] = {}
        """Velocities in mean counts by method, flux and first frame: the same in every repeat"""
        chunks = [photons.frame_light(chunk) for _, chunk in self._resized()]
        self._light = photons.not_black(np.concatenate(chunks))

    def sums(
        self, repeat: int, detectors: Sequence[Detector], advance: Callable[[int], object] | None
    ) -> list[Floats]:
        """Return the sums of each method, (4, fluxes, T), over one draw of the sequence."""
        fluxes = self._settings.fluxes
        to_light = [detector.start(self.shape) for detector in detectors]
        # responders to the counts, and to their means, of each flux
        started = [
            [(detector.start(self.shape), detector.start(self.shape)) for detector in detectors]
            for _ in fluxes
        ]
        sums: defaultdict[tuple[str, float], list[Floats]] = defaultdict(list)
        for first, frames in self._resized():
            light = frames / self._light[first : first + len(frames), None, None]
            ideals = [respond(light, self._pixels) for respond in to_light]
            # bright light first, which takes longest: the time left then only falls
            for flux, at_flux in zip(reversed(fluxes), reversed(started), strict=True):
                scale = self._pixels / flux
                means = light * flux + self._dark_counts
                key = *self.key, f"{flux:.6g}", repeat
                counts = photons.draw_counts(means, *key, first_frame=first)
                for detector, ideal, (respond, to_means) in zip(
                    detectors, ideals, at_flux, strict=True
                ):
                    reference = ideal
                    if not detector.ignores_offset:
                        case = detector.name, flux, first
                        kept = self._of_means.get(case)
                        reference = to_means(means, scale) if kept is None else kept
                        if detector.gives == "velocity":  # a few numbers; responses are frames
                            self._of_means[case] = reference
                    errors = error_sums(detector, reference, respond(counts, scale))
                    sums[detector.name, flux].append(errors)
                if advance:
                    advance(counts.size)
        return [
            np.stack([np.concatenate(sums[detector.name, flux], axis=1) for flux in fluxes], axis=1)
            for detector in detectors
        ]

    def _resized(self) -> Iterator[tuple[int, Frames]]:
        """Yield the numbers of first frames of chunks, and the chunks."""
        for first in range(0, self._frames.shape[0], CHUNK_FRAMES):
            chunk = np.asarray(self._frames[first : first + CHUNK_FRAMES])
            yield first, photons.resize(chunk, self.shape, self._settings.resize)
