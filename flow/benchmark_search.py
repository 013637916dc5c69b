"""Search for the photons that detectors need on a moving template, with few draws.

**Short sequences** that start at places spread around the template represent the dissertation's
sequence of 400 frames. Detectors with memory see clean frames first, so that only the noise has yet
to reach its strength; frames until then are drawn but not scored.

**Search.** Errors are measured only at the fluxes of a fixed lattice that a search needs. It starts
where a single pixel is precise enough, strides up or down by half decades as far as the error
suggests, and bisects the half decade in which the error crosses its level until its ends are
neighbors, or the curve between them is straight; it strides on while the interval of the crossing
is open. If the error falls below its level and rises again between fluxes that are not measured,
another crossing than the dissertation's first may be found.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import product

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.flow.benchmark import SearchSettings
from megalopta.flow.detectors.base import Detector, Frames, Responder
from megalopta.flow.detectors.registry import Method, method
from megalopta.flow.metrics.photon_threshold import ErrorCurve, error_curve
from megalopta.flow.metrics.response_error import Metric, error_of, error_sums
from megalopta.flow.stimuli.moving_template import MovingTemplate, sum_frames
from megalopta.flow.stimuli.photons import draw_in_one, narrowest

_MEAN_AT_TWO_BITS = 10.133
"""Count of a pixel with a relative error of 25 %; the error is proportional to its inverse root."""
_STRIDES_PER_DECADE = 2
"""Detectors with the same stride measure on the same counts, which are drawn once."""
_STRAIGHT = 0.05
"""Deviation in decades from F^−½ between two fluxes above which one between them is measured; it
moves a threshold by 1 to 3 %"""
_SMALLEST_ERROR = 1e-3
"""Smallest error, in levels; block matching reaches 0"""


def photon_search(
    stimulus: MovingTemplate,
    methods: Sequence[Method],
    settings: SearchSettings,
    seed: int,
    name: str,
) -> tuple[ErrorCurve, ...]:
    """Return a curve per method and metric, measured where the thresholds need it.

    Methods are detectors, their names, or functions (`detector_from`). Stimuli of different names
    and seeds are drawn independently. Raises ValueError if the frames are black or too small.
    """
    detectors = [method(chosen) for chosen in methods]
    sequences = ShortSequences(stimulus, settings, (seed, name), detectors)
    # detectors of the most frames first: the others see a part of these
    order = sorted(detectors, key=lambda detector: -detector.noise_memory_frames)
    curves = {detector.name: _Search(sequences, detector).curves() for detector in order}
    return tuple(curve for detector in detectors for curve in curves[detector.name])


class ShortSequences:
    """A stimulus at a few places, clean and as counts; counts are kept for other detectors."""

    def __init__(
        self,
        stimulus: MovingTemplate,
        settings: SearchSettings,
        key: tuple[int, str],
        methods: Sequence[Detector],
    ) -> None:
        self.settings = settings
        self.key = *key, f"{stimulus.size}x{stimulus.size}"
        self.shape = (stimulus.size, stimulus.size)
        self.pixels = stimulus.size**2
        self.dark_counts = settings.dark_counts * len(stimulus.template) ** 2 / self.pixels
        self._before = max(map(_warm_up_frames, methods), default=0)
        after = max((detector.noise_memory_frames for detector in methods), default=0)
        frames = self._before + after + settings.frames + settings.summed_frames - 1
        # evenly spread, but incommensurate with a grating: shares of a step between places by van
        # der Corput's sequence in base 2, 0, 1/2, 1/4, 3/4, …
        self._light = []
        for n in range(settings.phases):
            share = int(f"{n:b}"[::-1], 2) / (1 << n.bit_length())
            shift = int((n + share) / settings.phases * stimulus.template.shape[1])
            shift -= self._before * stimulus.velocity_px
            self._light.append(stimulus.light(shift, frames))
        self._brightest = max(float(light.max()) for light in self._light)
        self._counts: dict[tuple[float, int, int], Frames] = {}

    def clean(self, phase: int, before: int, frames: int) -> Floats:
        """Return frames at a place, and some before it, as shares of the flux."""
        pooled = sum_frames(self._light[phase], self.settings.summed_frames)
        return np.asarray(pooled[self._before - before : self._before + frames])

    def counts(self, flux: float, phase: int, repeat: int, frames: int) -> Frames:
        """Return counts of the first frames at a place."""
        name = (flux, phase, repeat)
        if len(self._counts.get(name, ())) < frames:
            drawn = frames + self.settings.summed_frames - 1
            light = self._light[phase][self._before : self._before + drawn]
            key = *self.key, f"{flux:.6g}", phase, repeat, 0
            counts = draw_in_one(light, flux, self.dark_counts, self._brightest, *key)
            if self.settings.summed_frames > 1:
                counts = narrowest(sum_frames(counts, self.settings.summed_frames))
            self._counts[name] = counts
        return self._counts[name][:frames]


def next_index(
    errors: Mapping[int, float],
    level: float,
    last: int,
    per_decade: int,
    straight: float,
    is_smooth: bool = False,
) -> int | None:
    """Return the next index on a lattice of fluxes in the search for the crossing of a level.

    None if the crossing is known well enough or lies outside the lattice.

    `errors`: by index of the flux, one or more; `last`: largest index; `per_decade`: fluxes per
    factor of ten; `straight`: decades by which the errors around the crossing may miss F^−½ and
    need no flux between them; `is_smooth`: whether to interpolate, not to halve its interval.
    """
    depths = {
        index: math.log10(max(error / level, _SMALLEST_ERROR)) for index, error in errors.items()
    }
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


def _stride(depth: float, per_decade: int) -> int:
    """Return the expected distance of the crossing from an error of 10^depth levels, in fluxes."""
    decades = min(1.5 * abs(depth), 2.0)
    return max(1, math.ceil(decades * _STRIDES_PER_DECADE)) * _shortest_stride(per_decade)


def _shortest_stride(per_decade: int) -> int:
    return max(1, per_decade // _STRIDES_PER_DECADE)


def _warm_up_frames(method: Detector) -> int:
    """Return the number of clean frames that a detector sees before the counts."""
    return method.memory_frames if method.memory_frames > 1 else 0


class _Search:
    """The errors of one detector over the flux, measured where its thresholds need them."""

    def __init__(self, sequences: ShortSequences, method: Detector) -> None:
        self._sequences, self._method = sequences, method
        settings, before = sequences.settings, _warm_up_frames(method)
        self._frames = method.noise_memory_frames + settings.frames
        clean = [sequences.clean(phase, before, self._frames) for phase in range(settings.phases)]
        self._before = [frames[:before] for frames in clean]
        self._clean = [frames[before:] for frames in clean]
        self._after: list[Callable[[float], Responder]] = []
        if method.gives == "response" and not method.takes_counts:
            # at the common brightness that they need, clean frames are the same at any flux
            gain = sequences.pixels / settings.summed_frames
            self._after = [method.after(frames, gain) for frames in self._before]
        self._ideal = [
            self._scored(frames * settings.flux_max, phase, settings.flux_max, 0.0)
            for phase, frames in enumerate(self._clean)
        ]
        self._is_exact = method.expected_deviation(self._clean[0][:1], 1.0) is not None
        """Whether errors come from a closed form, and no counts are drawn"""
        if self._is_exact:
            settings = settings.model_copy(update={"fluxes_per_decade": 100})  # closed forms: cheap
        self._settings, self._fluxes = settings, settings.fluxes
        self._step = _shortest_stride(settings.fluxes_per_decade)
        self._last = len(self._fluxes) - 1
        self._measured: dict[int, Floats] = {}

    def curves(self) -> list[ErrorCurve]:
        """Return one curve per metric."""
        # Velocities of rest in most blocks do not count as responses to clean frames: the remaining
        # ones are those few in which the subsampling of `nearest` happens to show a whole pixel.
        _, _, magnitude, scored = sum(
            error_sums(self._method, ideal, ideal).sum(axis=1) for ideal in self._ideal
        )
        possible = sum(self._method.scored(ideal)[..., 0].size for ideal in self._ideal)
        if 2 * scored >= possible and magnitude > 0:
            for metric, bits in product(self._settings.metrics, self._settings.bits):
                self._search(metric, bits)
        else:
            nothing = np.zeros((4, self._settings.repeats, self._settings.phases, 1))
            self._measured = {0: nothing, self._last: nothing}
        return [self._curve(metric, self._settings.bits) for metric in self._settings.metrics]

    def _search(self, metric: Metric, bits: int) -> None:
        """Measure as many fluxes as the threshold of an accuracy and its interval need."""
        settings, pixels = self._settings, self._sequences.pixels
        # start where the brightness of a pixel is known to this many bits
        needed = _MEAN_AT_TWO_BITS * 4.0 ** (bits - 2) * pixels
        dark = self._sequences.dark_counts * pixels
        flux = (needed + math.sqrt(needed**2 + 4 * needed * dark)) / 2  # F²/(F + dark) = needed
        start = round(math.log10(flux / settings.flux_min) * _STRIDES_PER_DECADE) * self._step
        # the curve of a matcher may be flat, then steep, yet fall as F^−½ overall
        bisects_always = self._is_exact or self._method.gives == "velocity"
        straight = 0.0 if bisects_always else _STRAIGHT
        index: int | None = min(max(start, 0), self._last)
        while index is not None:
            self._measure(index)
            errors = {index: error_of(sums, metric) for index, sums in self._measured.items()}
            per_decade = settings.fluxes_per_decade
            index = next_index(errors, 2.0**-bits, self._last, per_decade, straight, self._is_exact)
        if len(self._measured) == 1:  # a curve has two points
            self._measure(0)
            self._measure(self._last)
        while True:  # until fluxes on both sides bound the interval
            threshold = self._curve(metric, (bits,)).thresholds[bits]
            lowest, highest = min(self._measured), max(self._measured)
            if threshold.kind == "crossing" and threshold.low is None and lowest > 0:
                self._measure(max(lowest - self._step, 0))
            elif threshold.kind == "crossing" and threshold.high is None and highest < self._last:
                self._measure(min(highest + self._step, self._last))
            else:
                return

    def _curve(self, metric: Metric, bits: Sequence[int]) -> ErrorCurve:
        """Return the curve through the measured points."""
        indices = sorted(self._measured)
        sums = np.stack([self._measured[index] for index in indices], axis=1)
        *axes, places, frames = sums.shape
        starts = range(0, places * frames, frames)
        fluxes = [self._fluxes[index] for index in indices]
        of_sums = fluxes, sums.reshape(*axes, -1), starts, bits, self._sequences.key
        return error_curve(self._method, self._sequences.shape, metric, *of_sums)

    def _measure(self, index: int) -> None:
        """Keep the sums for the error at a flux, (4, repeats, places, scored frames)."""
        if index not in self._measured:
            flux, phases = self._fluxes[index], range(self._settings.phases)
            dark = self._sequences.dark_counts * self._settings.summed_frames
            sums = [self._sums_at_place(phase, flux, dark) for phase in phases]
            self._measured[index] = np.stack(sums, axis=2)

    def _sums_at_place(self, phase: int, flux: float, dark: float) -> Floats:
        """Return sums of errors, (4, repeats, scored frames)."""
        method, repeats = self._method, self._settings.repeats
        ideal = self._ideal[phase]
        if not method.ignores_offset:
            ideal = self._scored(self._clean[phase] * flux + dark, phase, flux, dark)
        # if frames are independent, one represents those of a place
        means = self._clean[phase][:1] * flux + dark
        if (deviation := method.expected_deviation(means, self._scale(flux))) is not None:
            expected = error_sums(method, ideal[:1], ideal[:1] + deviation)
            return np.repeat(expected[:, np.newaxis], repeats, axis=1)
        draws = []
        for repeat in range(repeats):
            counts = self._sequences.counts(flux, phase, repeat, self._frames)
            draws.append(error_sums(method, ideal, self._scored(counts, phase, flux, dark)))
        return np.stack(draws, axis=1)

    def _scored(self, frames: Frames, phase: int, flux: float, dark: float) -> Floats:
        """Return the scored responses at a place."""
        scale = self._scale(flux)
        if self._after:
            respond = self._after[phase](dark * scale)
        else:
            respond = self._method.after(self._before[phase], flux)(dark)
        return respond(frames, scale)[-self._sequences.settings.frames :]

    def _scale(self, flux: float) -> float:
        return self._sequences.pixels / (flux * self._sequences.settings.summed_frames)
