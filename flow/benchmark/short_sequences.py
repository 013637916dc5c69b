"""Short sequences of a moving template, and the error of a detector on counts drawn of them.

The sequence of the thesis, 400 frames, is represented by a few short ones that start at places
spread around the template. Detectors with a memory see clean frames first: what their filters have
kept from before is then right, and only the noise has yet to reach its strength; frames until then
are drawn and not scored. Draws are named by seed, stimulus, flux, place and repeat, and a detector
that needs few frames sees the first of those that another one sees.
"""

from collections.abc import Callable, Sequence

import numpy as np

from megalopta.flow.benchmark.settings import SearchSettings
from megalopta.flow.detectors.base import (
    Detector,
    FloatArray,
    Frames,
    Responder,
)
from megalopta.flow.metrics.response_error import ErrorSums, error_sums, sums_of_errors
from megalopta.flow.stimuli.moving_template import MovingTemplate, summed
from megalopta.flow.stimuli.photons import draw_in_one, narrowest


class ShortSequences:
    """A stimulus at a few places, clean and as counts; counts are kept, for other detectors.

    Parameters
    ----------
    stimulus
    settings
    seed : int
        Any integer.
    name : str
        Of the stimulus.
    methods
        Detectors that will see it.
    """

    def __init__(
        self,
        stimulus: MovingTemplate,
        settings: SearchSettings,
        seed: int,
        name: str,
        methods: Sequence[Detector],
    ) -> None:
        self.settings, self.seed = settings, seed
        self.key = (name, f"{stimulus.size}x{stimulus.size}")
        self.shape = (stimulus.size, stimulus.size)
        self.pixels = stimulus.size**2
        self.dark_counts = settings.dark_counts * len(stimulus.template) ** 2 / self.pixels
        self._before = max(map(warm_up_frames, methods), default=0)
        after = max((each.noise_memory_frames for each in methods), default=0) + settings.frames
        shifts = phase_shifts(stimulus.template.shape[1], settings.phases)
        self._light = [
            stimulus.light(
                shift - self._before * stimulus.velocity_px,
                self._before + after + settings.summed_frames - 1,
            )
            for shift in shifts
        ]
        self._brightest = max(float(light.max()) for light in self._light)
        self._counts: dict[tuple[float, int, int], Frames] = {}

    def clean(self, phase: int, before: int, frames: int) -> FloatArray:
        """Return frames at a place, after some that lead there, as shares of the flux."""
        pooled = summed(self._light[phase], self.settings.summed_frames)
        return np.asarray(pooled[self._before - before : self._before + frames])

    def counts(self, flux: float, phase: int, repeat: int, frames: int) -> Frames:
        """Return counts of the first frames at a place."""
        name = (flux, phase, repeat)
        if len(self._counts.get(name, ())) < frames:
            drawn = frames + self.settings.summed_frames - 1
            light = self._light[phase][self._before : self._before + drawn]
            counts = draw_in_one(
                light,
                flux,
                self.dark_counts,
                self.seed,
                *(*self.key, f"{flux:.6g}", phase, repeat),
                brightest=self._brightest,
            )
            if self.settings.summed_frames > 1:
                counts = narrowest(summed(counts, self.settings.summed_frames))
            self._counts[name] = counts
        return self._counts[name][:frames]


class DetectorErrors:
    """One detector's responses to counts against those to clean frames."""

    def __init__(self, sequences: ShortSequences, method: Detector) -> None:
        self._sequences, self._method = sequences, method
        settings, before = sequences.settings, warm_up_frames(method)
        self._phases = range(settings.phases)
        self._frames = method.noise_memory_frames + settings.frames
        clean = [sequences.clean(phase, before, self._frames) for phase in self._phases]
        self._before = [frames[:before] for frames in clean]
        self._clean = [frames[before:] for frames in clean]
        self._after: list[Callable[[float], Responder]] = []
        if method.gives == "response" and not method.takes_counts:
            # at common brightness, which they ask for, clean frames are the same at any flux
            gain = sequences.pixels / settings.summed_frames
            self._after = [method.after(frames, gain) for frames in self._before]
        self._ideal = [self._to_light(phase, settings.flux_max, 0.0) for phase in self._phases]

    @property
    def is_defined(self) -> bool:
        """Whether the detector answers to the clean frames at all.

        One that gives velocities and reads rest in most of its blocks does not: what is left are
        the few in which the subsampling of `nearest` happens to show a whole pixel.
        """
        sums = [error_sums(self._method, ideal, ideal) for ideal in self._ideal]
        possible = sum(self._method.scored(ideal)[..., 0].size for ideal in self._ideal)
        moving = sum(each.scored.sum() for each in sums)
        return 2 * moving >= possible and any(each.magnitude.any() for each in sums)

    @property
    def is_exact(self) -> bool:
        """Whether errors come from a closed form, and no counts are drawn."""
        return self._method.expected_deviation(self._clean[0][:1], 1.0) is not None

    def errors(self, flux: float) -> ErrorSums:
        """Return what the error at a flux is made of, (repeats, places, scored frames)."""
        dark = self._sequences.dark_counts * self._sequences.settings.summed_frames
        places = [self._at_place(phase, flux, dark) for phase in self._phases]
        return ErrorSums(*np.stack(places, axis=2))

    def _at_place(self, phase: int, flux: float, dark: float) -> FloatArray:
        """Return sums of errors, (4, repeats, scored frames)."""
        method, repeats = self._method, self._sequences.settings.repeats
        scale = self._scale(flux)
        has_own = self._sequences.settings.compares_with_means(method)
        ideal = self._to_light(phase, flux, dark) if has_own else self._ideal[phase]
        # where frames are independent of each other, one stands for those of a place
        means = self._clean[phase][:1] * flux + dark
        if (deviation := method.expected_deviation(means, scale)) is not None:
            expected = sums_of_errors(method, ideal[:1], ideal[:1] + deviation)
            return np.repeat(expected[:, np.newaxis], repeats, axis=1)
        draws = []
        for repeat in range(repeats):
            counts = self._sequences.counts(flux, phase, repeat, self._frames)
            noisy = self._scored(counts, phase, flux, dark)
            draws.append(sums_of_errors(method, ideal, noisy))
        return np.stack(draws, axis=1)

    def _to_light(self, phase: int, flux: float, dark: float) -> FloatArray:
        """Return the scored responses at a place to the mean counts."""
        return self._scored(self._clean[phase] * flux + dark, phase, flux, dark)

    def _scored(self, frames: Frames, phase: int, flux: float, dark: float) -> FloatArray:
        """Return the scored responses at a place."""
        scale = self._scale(flux)
        if self._after:
            respond = self._after[phase](dark * scale)
        else:
            respond = self._method.after(self._before[phase], flux)(dark)
        return respond(frames, scale)[-self._sequences.settings.frames :]

    def _scale(self, flux: float) -> float:
        return self._sequences.pixels / (flux * self._sequences.settings.summed_frames)


def warm_up_frames(method: Detector) -> int:
    """Return the number of clean frames that a detector sees before the counts."""
    return method.memory_frames if method.memory_frames > 1 else 0


def phase_shifts(columns: int, phases: int) -> list[int]:
    """Return places around a template (px), spread evenly but in no step with a grating on it."""
    return [int((phase + _van_der_corput(phase)) / phases * columns) for phase in range(phases)]


def _van_der_corput(number: int) -> float:
    """Return a number of the sequence in base 2: 0, 1/2, 1/4, 3/4 and so on."""
    return sum((number >> place & 1) / (2 << place) for place in range(number.bit_length()))
