"""Comparison of a captured and a simulated recording: faults first, then the parameters.

Steps, each of which leaves to the next what it cannot explain:

1. repeated and missing frames (`in_time`), bits and codes of the ADC (`converter`)
2. order of the pixels (`arrangement`), which is undone
3. dead and stuck lines and pixels (`pattern`), which are masked
4. frames that depend on those before, beside which no test that assumes independent ones is made;
   drift, flicker, banding, common noise (`in_time`), which are subtracted
5. light that is uneven over the array (`uneven`), which is subtracted
6. rows and columns with an offset, which is subtracted; telegraph noise, hot and deviating pixels,
   which are masked (`pattern`)
7. parameters of the device that explain the rest, or none (`causes`)
8. tests of every pixel that is left (`two_sample`)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.calibrate.telegraph import correlation
from megalopta.sensor.compare.arrangement import Arrangement, arrangement
from megalopta.sensor.compare.causes import Causes, Doubts, find_causes
from megalopta.sensor.compare.converter import stuck_bits, uneven_codes
from megalopta.sensor.compare.faults import Fault, pixels_of
from megalopta.sensor.compare.in_time import (
    dependent_frames,
    missing_frames,
    steadied,
    without_repeats,
)
from megalopta.sensor.compare.model import Model, level_of_codes
from megalopta.sensor.compare.pattern import (
    LineOffset,
    deviations,
    odd_lines,
    odd_pixels,
    telegraph_fault,
    unresponsive,
)
from megalopta.sensor.compare.quantities import BLOCKS
from megalopta.sensor.compare.two_sample import (
    Difference,
    Distances,
    PixelTest,
    Sample,
    discoveries,
    distances_by_chance,
    histogram_test,
    mean_test,
    variance_test,
)
from megalopta.sensor.compare.uneven import uneven_light

FALSE_ALARMS = 0.01
"""Largest share of comparisons of a device with itself that raise an alarm."""
MARGIN = 0.05
"""Negligible relative difference."""
_FAMILIES = 5
_FEWEST_FRAMES = 3 * BLOCKS


@dataclass(frozen=True, eq=False)
class Comparison:
    """Differences of two recordings."""

    arrangement: Arrangement
    """Order of the captured pixels"""
    faults: tuple[Fault, ...]
    """Faults found before anything was fitted"""
    explained: Causes
    """Parameters of the device that explain the rest"""
    differences: tuple[Difference, ...]
    """Quantities of the device, or of a scene"""
    tests: Mapping[str, PixelTest]
    """Tests of mean, variance and histogram of pixels at all levels, (levels, rows, columns)"""
    distances: Distances
    """Distances between histograms, (levels, rows, columns), and of samples of one distribution"""
    by_chance: Distances
    margin: float

    @property
    def causes(self) -> tuple[Difference, ...]:
        """Quantities that explain the difference and exceed the margin, largest first."""
        real = [each for each in self.significant if not each.is_equivalent]
        return tuple(sorted(real, key=lambda each: -each.size))

    @property
    def significant(self) -> list[Difference]:
        """Quantities that explain the difference."""
        if not self.explained.is_different and not self.explained.alone:
            return beyond_chance(self.differences)  # of a scene
        if not self.explained.accepted:
            return []
        names = self.explained.accepted[0].names
        return [each for each in self.differences if each.name in names]

    @property
    def alarms(self) -> tuple[str, ...]:
        """Sentences on every significant difference."""
        found = [str(self.arrangement)] if self.arrangement.is_other else []
        found += map(str, self.faults)
        found += map(str, self.significant)
        if self.explained.is_unexplained:
            found.append(_NONE)
        for name, test in self.tests.items():
            if test.differs.any():
                many = f"{test.differs.sum()} of {np.isfinite(test.p).sum()}"
                where = pixels_of(np.asarray(test.differs.any(axis=0)))
                found.append(f"the {name} differs in {many} tests, of {where}")
        return tuple(found)

    @property
    def sentence(self) -> str:
        """Summary of the differences and their size."""
        named = [str(self.arrangement)] if self.arrangement.is_other else []
        named += map(str, self.faults)
        if self.causes:
            others = self.explained.accepted[1:]
            or_else = "".join(f", or else {' and '.join(each.names)}" for each in others)
            named.append("; ".join(map(str, self.causes)) + or_else)
        if self.explained.is_unexplained:
            named.append(_NONE if not named else _NONE_OF_REST)
        if named:
            return f"Captured: {'; '.join(named)}."
        if not self.alarms:
            return "No difference is statistically significant."
        largest = max(self.significant, key=lambda each: each.size, default=None)
        first = self.alarms[0]
        limit = f"; of the device, at most: {largest}" if largest and str(largest) != first else ""
        return f"Differences are statistically significant but small: {first}{limit}."


_NONE = "none of the known causes explains the difference"
_NONE_OF_REST = "none of the known causes explains the rest of the difference"


def beyond_chance(tested: Sequence[Difference]) -> list[Difference]:
    """Return the significant differences of one family of tests."""
    limit = FALSE_ALARMS / _FAMILIES / max(len(tested), 1)
    return [each for each in tested if each.p < limit]


@dataclass
class _Cleaned:
    """Recordings in the course of the comparison: what is found is taken out."""

    captured: list[Level]
    expected: list[Level]
    model: Model
    errors: Sequence[Floats]
    faults: list[Fault] = field(default_factory=list)
    masked: Mask = field(default_factory=lambda: np.zeros((0, 0), np.bool_))
    is_uneven: bool = False
    """True if codes of the ADC are missing or uneven."""
    unsure: list[dict[str, float]] = field(default_factory=list)
    are_dependent: bool = False
    """True if frames depend on those before."""

    @property
    def good(self) -> list[Mask]:
        """Usable pixels of every level."""
        pairs = zip(self.captured, self.expected, strict=True)
        return [one.usable & other.usable & ~self.masked for one, other in pairs]

    def check_frames(self) -> None:
        """Repeated and missing frames."""
        by_level = []
        for at, (one, other) in enumerate(zip(self.captured, self.expected, strict=True)):
            gaps = missing_frames(one)
            self.captured[at], repeated = without_repeats(one, other)
            by_level.append([*repeated, *gaps])
        self.faults += _merged(by_level, self.captured)

    def check_codes(self) -> None:
        """Bits and codes of the ADC."""
        codes = [[level.codes for level in each if level.codes is not None]
                 for each in (self.captured, self.expected)]  # fmt: skip
        if not codes[0] or not codes[1]:
            return
        stuck = stuck_bits(*codes)
        for bit in stuck:
            self.faults.append(bit.fault)
            for at, level in enumerate(self.expected):
                if level.codes is not None:
                    spoilt = bit.on(level.codes)
                    self.expected[at] = level_of_codes(
                        spoilt, self.model.sensor, level.exposure_s, level.light_hz, level.times_s
                    )
        uneven = [] if stuck else uneven_codes(*codes)
        self.faults += uneven
        self.is_uneven = bool(uneven)

    def reorder(self, found: Arrangement) -> None:
        """Undo another order of the pixels."""
        names = "readings", "saturated", "codes", "unrounded"
        for at, level in enumerate(self.captured):
            kept = {name: getattr(level, name) for name in names}
            turned: dict[str, Any] = {
                name: found.undone(each) for name, each in kept.items() if each is not None
            }
            self.captured[at] = replace(level, **turned)

    def mask_unresponsive(self) -> None:
        """Dead and stuck pixels and lines."""
        dead, stuck, faults = unresponsive(self.captured, self.expected)
        self.masked = dead | stuck
        self.faults += faults

    def steady(self) -> None:
        """Frames that depend on those before, or drift, flicker, banding and common noise."""
        levels = zip(self.captured, self.expected, self.good, strict=True)
        dependent = [dependent_frames(*each) for each in levels]
        self.are_dependent = any(dependent)
        if self.are_dependent:
            self.faults += _merged(dependent, self.captured)
            return
        found = steadied(self.captured, self.good, self.model.parts(self.expected))
        self.captured = [each.level for each in found]
        self.unsure = [each.unsure for each in found]
        if self.is_uneven:  # as noise of some codes would
            for each in self.unsure:
                each["read noise"] = self.model.counts_per_code**2
        self.faults += _merged([each.faults for each in found], self.captured)

    def check_light(self) -> None:
        """Light that is uneven over the array."""
        parts = self.model.parts(self.expected)
        found = uneven_light(self.captured, self._deviations(), self.good, parts)
        if found is not None:
            self.faults.append(found.fault)
            for at, part in enumerate(parts):
                self._subtract(at, found.surface * part.light)

    def check_pattern(self) -> None:
        """Lines and single pixels."""
        flickering, known = np.zeros((2, *self.masked.shape), np.bool_)
        if not self.are_dependent:
            for one, other, own in zip(self.captured, self.expected, self.good, strict=True):
                flickering |= correlation(one.signal, own).is_telegraph
                known |= correlation(other.signal, own).is_telegraph
        self.masked = self.masked | flickering | known
        parts, volts = self.model.parts(self.expected), self.model.volts_per_count
        volts = volts if self.captured[0].codes is not None else 0.0
        offsets, odd, faults = odd_lines(self.captured, self._deviations(), self.good, parts, volts)
        for each in offsets:
            self._take_out(each)
        self.masked = self.masked | odd
        alone, more = odd_pixels(self.captured, self.expected, self._deviations(), self.good, parts)
        self.masked = self.masked | alone
        self.faults += [*faults, *telegraph_fault(flickering & ~known), *more]

    def _deviations(self) -> list[Any]:
        each = zip(self.captured, self.expected, self.good, self.errors, strict=True)
        return [deviations(*one) for one in each]

    def _take_out(self, line: LineOffset) -> None:
        counts = np.zeros(self.masked.shape)
        counts[(line.place,) if line.axis == 0 else (slice(None), line.place)] = line.counts
        for at in range(len(self.captured)):
            self._subtract(at, counts)

    def _subtract(self, at: int, counts: Floats) -> None:
        """Subtract counts (rows, columns) from all frames of a level."""
        level, take = self.captured[at], counts != 0
        signal = np.array(level.signal, np.float32)
        signal[:, take] -= counts[take].astype(np.float32)
        if level.unrounded is None:
            self.captured[at] = replace(level, readings=signal)
        else:
            readings = np.array(level.readings)
            readings[:, take] = np.rint(signal[:, take].clip(0)).astype(readings.dtype)
            self.captured[at] = replace(level, unrounded=signal, readings=readings)


def _merged(by_level: Sequence[Sequence[Fault]], levels: Sequence[Level]) -> list[Fault]:
    """One fault of each kind, with the recordings in which it is seen."""
    kinds: dict[str, list[tuple[int, Fault]]] = {}
    for at, faults in enumerate(by_level):
        for each in faults:
            kinds.setdefault(each.kind, []).append((at, each))
    found = []
    for kind, seen in kinds.items():
        places = sorted({at for at, _ in seen})
        where = f"at {levels[places[0]]}" if len(places) == 1 else (
            f"in {len(places)} of {len(levels)} recordings"
        )  # fmt: skip
        # of the last recording the first, which is the strongest
        text = next(each for at, each in seen if at == places[-1])
        found.append(Fault(kind, f"{text}, {where}"))
    return found


def compare_recordings(
    captured: Sequence[Level],
    expected: Sequence[Level],
    model: Model,
    *,
    margin: float = MARGIN,
    errors: Sequence[Floats | float] | None = None,
    is_scene: bool = False,
) -> Comparison:
    """Compare recordings level by level.

    Parameters
    ----------
    captured, expected : sequence of Level
        The same levels in the same order; numbers of frames may differ.
    model : Model
        Device that the expected recordings are of.
    margin : float
        Negligible relative difference.
    errors : sequence of (rows, columns) arrays, optional
        Standard errors of each level's expected mean counts, if from a calibration; NaN for pixels
        that it does not know, which are masked.
    is_scene : bool
        True if light changes in time, so that neither steadiness nor parameters are tested.

    Raises ValueError if levels differ in shape or have too few frames.
    """
    _check(captured, expected)
    shape = captured[0].readings.shape[1:]
    unsure = [np.broadcast_to(each, shape) for each in errors or [0.0] * len(captured)]
    cleaned = _Cleaned(list(captured), list(expected), model, unsure)
    cleaned.check_frames()
    cleaned.check_codes()
    order = _arrangement(list(zip(cleaned.captured, cleaned.expected, strict=True)))
    if order.is_other:
        cleaned.reorder(order)
    cleaned.mask_unresponsive()
    cleaned.masked = cleaned.masked | ~np.isfinite(np.sum(unsure, axis=0))
    causes = Causes(1.0, 1.0, (), ())
    if not is_scene:
        cleaned.steady()
        cleaned.check_light()
        cleaned.check_pattern()
        causes = causes if cleaned.are_dependent else _causes(cleaned, margin)
    tests, distances, chance = _pixel_tests(cleaned)
    return Comparison(
        order, tuple(cleaned.faults), causes, causes.alone, tests, distances, chance, margin
    )


def _causes(cleaned: _Cleaned, margin: float) -> Causes:
    maps = {"dark counts": 0.0, "efficiency": 0.0}
    parts = cleaned.model.parts(cleaned.expected)
    for part, error, own, level in zip(
        parts, cleaned.errors, cleaned.good, cleaned.expected, strict=True
    ):
        total = max(float(part.mean[own].sum()), 1e-300)
        name = "dark counts" if level.is_dark else "efficiency"
        maps[name] = max(maps[name], float(np.sqrt(np.square(error[own]).sum())) / total)
    doubts = Doubts(cleaned.unsure, maps)
    return find_causes(
        cleaned.captured, cleaned.expected, cleaned.good, cleaned.model,
        margin=margin, doubts=doubts,
    )  # fmt: skip


def _pixel_tests(cleaned: _Cleaned) -> tuple[dict[str, PixelTest], Distances, Distances]:
    p_values, distances, chance = [], [], []
    for one, other, own, error in zip(
        cleaned.captured, cleaned.expected, cleaned.good, cleaned.errors, strict=True
    ):
        a, b = one.readings, other.readings
        of_histograms, apart = histogram_test(a, b)
        samples = Sample.of(a), Sample.of(b)
        tests = mean_test(*samples, error), variance_test(*samples), of_histograms
        is_tested = own & (not cleaned.are_dependent)
        p_values.append([np.where(is_tested, p, np.nan) for p in tests])
        distances.append(apart)
        chance.append(distances_by_chance(a, b))
    families = zip(("mean", "variance", "histogram"), zip(*p_values, strict=True), strict=True)
    rate = FALSE_ALARMS / _FAMILIES
    found = {name: discoveries(np.array(p), rate) for name, p in families}
    return found, _stacked(distances), _stacked(chance)


def _stacked(levels: Sequence[Distances]) -> Distances:
    return Distances(*(np.array(each) for each in zip(*levels, strict=True)))


def _check(captured: Sequence[Level], expected: Sequence[Level]) -> None:
    if not captured or len(captured) != len(expected):
        raise ValueError(
            f"{len(captured)} captured levels and {len(expected)} expected ones; give the same"
        )
    for one, other in zip(captured, expected, strict=True):
        shapes = one.readings.shape[1:], other.readings.shape[1:]
        if shapes[0] != shapes[1]:
            raise ValueError(f"frames of {shapes[0]} and of {shapes[1]} pixels; give the same")
        fewest = min(len(one.readings), len(other.readings))
        if fewest < _FEWEST_FRAMES:
            raise ValueError(f"{fewest} frames; compare {_FEWEST_FRAMES} or more")


def _arrangement(pairs: Sequence[tuple[Level, Level]]) -> Arrangement:
    """Arrangement by the dark level of the most counts, which shows the pattern best.

    Without a dark one, by the first level.
    """
    one, other = max(pairs, key=lambda each: float(each[1].readings.sum()) * each[1].is_dark)
    return arrangement(one.readings.mean(axis=0), other.readings.mean(axis=0))
