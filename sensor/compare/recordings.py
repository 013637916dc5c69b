"""Comparison of a captured and a simulated recording: faults first, then the parameters.

Steps, each of which leaves to the next what it cannot explain:

1. repeated and missing frames (`in_time`), bits and codes of the ADC (`faults`)
2. order of the pixels (`faults`), which is undone
3. dead and stuck lines and pixels (`pattern`), which are masked
4. frames that depend on those before, beside which no test that assumes independent ones is made;
   drift, flicker, banding, common noise (`in_time`), which are subtracted
5. light that is uneven over the array (`pattern`), which is subtracted
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
from megalopta.sensor.calibrate.pixels import correlation
from megalopta.sensor.compare import in_time, pattern, two_sample
from megalopta.sensor.compare.causes import Causes, find_causes
from megalopta.sensor.compare.faults import (
    Arrangement,
    Fault,
    arrangement,
    pixels_of,
    stuck_bits,
    uneven_codes,
)
from megalopta.sensor.compare.model import Model, Unsure, level_of_codes

FALSE_ALARMS = 0.01
"""Largest share of comparisons of a device with itself that raise an alarm."""
MARGIN = 0.05
"""Negligible relative difference."""
_FAMILIES = 5
_FEWEST_FRAMES = 3 * two_sample.BLOCKS


@dataclass(frozen=True, eq=False)
class Comparison:
    """Differences of two recordings."""

    arrangement: Arrangement
    """Order of the captured pixels"""
    faults: tuple[Fault, ...]
    """Faults found before anything was fitted"""
    explained: Causes
    """Parameters of the device that explain the rest"""
    differences: tuple[two_sample.Difference, ...]
    """Quantities of the device, or of a scene"""
    tests: Mapping[str, two_sample.PixelTest]
    """Tests of mean, variance and histogram of pixels at all levels, (levels, rows, columns)"""
    margin: float

    @property
    def causes(self) -> tuple[two_sample.Difference, ...]:
        """Quantities that explain the difference and exceed the margin, largest first."""
        real = [each for each in self.significant if not each.is_equivalent]
        return tuple(sorted(real, key=lambda each: -each.size))

    @property
    def significant(self) -> list[two_sample.Difference]:
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


def beyond_chance(tested: Sequence[two_sample.Difference]) -> list[two_sample.Difference]:
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
    masked: Mask
    unsure: list[Unsure]
    faults: list[Fault] = field(default_factory=list)
    is_uneven: bool = False
    """True if codes of the ADC are missing or uneven."""
    are_dependent: bool = False
    """True if frames depend on those before."""

    @property
    def pairs(self) -> list[tuple[Level, Level]]:
        """Captured and expected recording of every level."""
        return list(zip(self.captured, self.expected, strict=True))

    @property
    def good(self) -> list[Mask]:
        """Usable pixels of every level."""
        return [one.usable & other.usable & ~self.masked for one, other in self.pairs]

    def check_frames(self) -> None:
        """Repeated and missing frames."""
        by_level = []
        for at, (one, other) in enumerate(self.pairs):
            gaps = in_time.missing_frames(one)
            self.captured[at], repeated = in_time.without_repeats(one, other)
            by_level.append([*repeated, *gaps])
        self.faults += _merged(by_level, self.captured)

    def check_codes(self) -> None:
        """Bits and codes of the ADC."""
        seen, known = (
            [level.codes for level in levels if level.codes is not None]
            for levels in (self.captured, self.expected)
        )
        if not seen or not known:
            return
        stuck = stuck_bits(seen, known)
        for bit in stuck:
            self.faults.append(bit.fault)
            for at, level in enumerate(self.expected):
                if level.codes is not None:
                    spoilt = bit.on(level.codes)
                    self.expected[at] = level_of_codes(
                        spoilt, self.model.sensor, level.exposure_s, level.light_hz, level.times_s
                    )
        uneven = [] if stuck else uneven_codes(seen, known)
        self.faults += uneven
        self.is_uneven = bool(uneven)

    def reorder(self) -> Arrangement:
        """Find another order of the pixels, and undo it."""
        # the dark level of the most counts shows the pattern best
        one, other = max(
            self.pairs, key=lambda pair: float(pair[1].readings.sum()) * pair[1].is_dark
        )
        order = arrangement(one.readings.mean(axis=0), other.readings.mean(axis=0))
        names = "readings", "saturated", "codes", "unrounded"
        for at, level in enumerate(self.captured if order.is_other else ()):
            kept = {name: getattr(level, name) for name in names}
            turned: dict[str, Any] = {
                name: order.undone(each) for name, each in kept.items() if each is not None
            }
            self.captured[at] = replace(level, **turned)
        return order

    def mask_unresponsive(self) -> None:
        """Dead and stuck pixels and lines."""
        masked, faults = pattern.unresponsive(self.captured, self.expected)
        self.masked = self.masked | masked
        self.faults += faults

    def steady(self) -> None:
        """Frames that depend on those before, or drift, flicker, banding and common noise."""
        levels = zip(self.captured, self.expected, self.good, strict=True)
        dependent = [in_time.dependent_frames(*each) for each in levels]
        self.are_dependent = any(dependent)
        if self.are_dependent:
            self.faults += _merged(dependent, self.captured)
            return
        found = in_time.steadied(self.captured, self.good, self.model.parts(self.expected))
        self.captured = [each.level for each in found]
        self.unsure = [each.unsure for each in found]
        if self.is_uneven:  # as noise of some codes would
            noise = self.model.counts_per_code**2
            self.unsure = [each._replace(read_noise=noise) for each in self.unsure]
        self.faults += _merged([each.faults for each in found], self.captured)

    def check_light(self) -> None:
        """Light that is uneven over the array."""
        apart = self._deviations()
        uneven = pattern.uneven_light(self.captured, apart)
        if uneven is not None:
            self.faults.append(uneven[1])
            for at, each in enumerate(apart):
                self._subtract(at, uneven[0] * each.parts.light)

    def check_pattern(self) -> None:
        """Telegraph noise, lines and single pixels."""
        flickering, known = np.zeros((2, *self.masked.shape), np.bool_)
        if not self.are_dependent:
            for (one, other), good in zip(self.pairs, self.good, strict=True):
                flickering |= correlation(one.signal, good).is_telegraph
                known |= correlation(other.signal, good).is_telegraph
        self.masked = self.masked | flickering | known
        has_codes = self.captured[0].codes is not None
        volts = self.model.volts_per_count if has_codes else 0.0
        offsets, odd, faults = pattern.odd_lines(self._deviations(), volts)
        for counts in offsets:
            for at in range(len(self.captured)):
                self._subtract(at, counts)
        self.masked = self.masked | odd
        alone, more = pattern.odd_pixels(self.captured, self.expected, self._deviations())
        self.masked = self.masked | alone
        self.faults += faults
        if (flickering & ~known).any():
            text = f"telegraph noise in {pixels_of(flickering & ~known)}"
            self.faults.append(Fault("telegraph noise", text))
        self.faults += more

    def _deviations(self) -> list[pattern.Deviations]:
        parts = self.model.parts(self.expected)
        levels = zip(self.captured, self.expected, self.good, self.errors, parts, strict=True)
        return [pattern.deviations(*each) for each in levels]

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

    def causes(self, margin: float) -> Causes:
        """Parameters that explain what is left."""
        # errors of the calibration, relative ones of the array's dark counts and efficiency
        maps = Unsure()
        parts = self.model.parts(self.expected)
        for part, error, good, level in zip(
            parts, self.errors, self.good, self.expected, strict=True
        ):
            total = max(float(part.mean[good].sum()), 1e-300)
            share = float(np.sqrt(np.square(error[good]).sum())) / total
            if level.is_dark:
                maps = maps._replace(dark_counts=max(maps.dark_counts, share))
            else:
                maps = maps._replace(efficiency=max(maps.efficiency, share))
        return find_causes(
            self.captured, self.expected, self.good, self.model,
            margin=margin, unsure=self.unsure, maps=maps,
        )  # fmt: skip

    def pixel_tests(self) -> dict[str, two_sample.PixelTest]:
        """Tests of mean, variance and histogram of every pixel."""
        p_values = []
        for (one, other), good, error in zip(self.pairs, self.good, self.errors, strict=True):
            samples = two_sample.Sample.of(one.readings), two_sample.Sample.of(other.readings)
            tests = (
                two_sample.mean_test(*samples, error),
                two_sample.variance_test(*samples),
                two_sample.histogram_test(one.readings, other.readings),
            )
            is_tested = good & (not self.are_dependent)
            p_values.append([np.where(is_tested, p, np.nan) for p in tests])
        families = zip(("mean", "variance", "histogram"), zip(*p_values, strict=True), strict=True)
        rate = FALSE_ALARMS / _FAMILIES
        return {name: two_sample.discoveries(np.array(p), rate) for name, p in families}


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
    errors: Sequence[Floats] | None = None,
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
    shape = captured[0].readings.shape[1:]
    errors = errors or [np.zeros(shape)] * len(captured)
    known = np.isfinite(np.sum(errors, axis=0))
    cleaned = _Cleaned(
        list(captured), list(expected), model, errors,
        masked=~known, unsure=[Unsure()] * len(captured),
    )  # fmt: skip
    cleaned.check_frames()
    cleaned.check_codes()
    order = cleaned.reorder()
    cleaned.mask_unresponsive()
    causes = Causes()
    if not is_scene:
        cleaned.steady()
        cleaned.check_light()
        cleaned.check_pattern()
        causes = causes if cleaned.are_dependent else cleaned.causes(margin)
    tests = cleaned.pixel_tests()
    return Comparison(order, tuple(cleaned.faults), causes, causes.alone, tests, margin)
