"""Comparison of a captured and a simulated recording: faults first, then the parameters.

Each step leaves to the next what it cannot explain.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from megalopta.core.arrays import Floats, Mask
from megalopta.core.quantities import with_error
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.calibrate.pixels import correlation
from megalopta.sensor.compare import faults as readout, in_time, pattern, two_sample
from megalopta.sensor.compare.causes import Causes, find_causes
from megalopta.sensor.compare.model import Model, level_of_codes
from megalopta.sensor.compare.residual import Residual

FALSE_ALARMS = 0.01
"""Largest share of comparisons of a device with itself that raise an alarm."""
MARGIN = 0.05
"""Negligible relative difference."""
_FAMILIES = 5
_FEWEST_FRAMES = 3 * two_sample.BLOCKS


@dataclass(frozen=True, eq=False)
class Comparison:
    """Differences of two recordings."""

    arrangement: readout.Arrangement
    """Order of the captured pixels"""
    faults: tuple[readout.Fault, ...]
    """Faults found before anything was fitted"""
    explained: Causes
    """Parameters of the device that explain the rest"""
    differences: tuple[two_sample.Difference, ...]
    """Quantities of the device, or of a scene"""
    tests: Mapping[str, two_sample.PixelTest]
    """Tests of mean and variance of pixels at all levels, (levels, rows, columns)"""
    margin: float

    @property
    def causes(self) -> tuple[two_sample.Difference, ...]:
        """Quantities that explain the difference and exceed the margin, largest first."""
        real = [cause for cause in self.significant if not cause.is_equivalent]
        return tuple(sorted(real, key=lambda cause: -cause.size))

    @property
    def significant(self) -> list[two_sample.Difference]:
        """Quantities that explain the difference."""
        if not self.explained.is_different and not self.explained.alone:  # of a scene
            limit = FALSE_ALARMS / _FAMILIES / max(len(self.differences), 1)
            return [difference for difference in self.differences if difference.p < limit]
        names = self.explained.accepted[0].names if self.explained.accepted else ()
        return [difference for difference in self.differences if difference.name in names]

    @property
    def _faults(self) -> list[str]:
        """Phrases on what was found before anything was fitted."""
        order = [str(self.arrangement)] if self.arrangement.is_other else []
        return [*order, *map(str, self.faults)]

    @property
    def alarms(self) -> tuple[str, ...]:
        """Phrases on every significant difference."""
        phrases = [*self._faults, *map(str, self.significant)]
        if self.explained.is_unexplained:
            phrases.append(_NONE)
        for name, test in self.tests.items():
            if test.differs.any():
                many = f"{test.differs.sum()} of {np.isfinite(test.p).sum()}"
                where = readout.pixels_of(np.asarray(test.differs.any(axis=0)))
                phrases.append(f"the {name} differs in {many} tests, of {where}")
        return tuple(phrases)

    @property
    def sentence(self) -> str:
        """Verdict on the device with its sizes, and then the faults of the recording."""
        faults = self._faults
        small = self.alarms[len(faults) :]
        if self.causes:
            alternatives = self.explained.accepted[1:]
            or_else = "".join(f", or else {' and '.join(other.names)}" for other in alternatives)
            sizes = "; ".join(map(str, self.causes))
            verdict = f"The captured device differs: {sizes}{or_else} (95 % CI)."
        elif self.explained.is_unexplained:
            verdict = f"Captured and simulated frames differ; {_NONE}."
        elif not self.differences:
            verdict = "Neither parameters nor pixels can be compared."
        elif small:
            largest = max(self.significant, key=lambda difference: difference.size, default=None)
            is_other = largest and str(largest) != small[0]
            limit = f"; of the device, at most: {largest}" if is_other else ""
            verdict = f"Differences are statistically significant but small: {small[0]}{limit}."
        else:
            verdict = f"{agreement('frames', self.differences)}."
        if not faults:
            return verdict
        return f"{verdict} Found before, and not counted in this: {'; '.join(faults)}."


_NONE = "none of the known causes explains the difference"


def agreement(what: str, differences: Sequence[two_sample.Difference]) -> str:
    """Return that nothing differs, within which interval, and what is too uncertain to tell."""
    relative = [change for change in differences if not change.base]
    equal = [change for change in relative if change.is_equivalent]
    open_ = [change.name for change in differences if not change.is_equivalent]
    text = f"Captured and simulated {what} agree: no difference is statistically significant"
    if equal:
        most = max(max(abs(change.low), abs(change.high)) for change in equal)
        names = f": {', '.join(change.name for change in equal)}" if open_ else ""
        text += f"; equal within {with_error(100 * most, 0, '%')} (95 % CI){names}"
    return text + (f"; too uncertain to tell: {', '.join(open_)}" if open_ else "")


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

    Raises ValueError if levels differ in shape, have too few frames or never change.
    """
    if not captured or len(captured) != len(expected):
        raise ValueError(
            f"{len(captured)} captured levels and {len(expected)} expected ones; give the same"
        )
    for first, second in zip(captured, expected, strict=True):
        (n, *shape), (m, *other) = first.readings.shape, second.readings.shape
        if shape != other:
            raise ValueError(
                f"frames of {tuple(shape)} and of {tuple(other)} pixels; give the same"
            )
        if min(n, m) < _FEWEST_FRAMES:
            raise ValueError(f"{min(n, m)} frames; compare {_FEWEST_FRAMES} or more")
    if all((level.readings == level.readings[:1]).all() for level in (*captured, *expected)):
        raise ValueError(
            "no reading of any pixel changes, captured or simulated: the counters are full or "
            "empty; capture with another light or exposure"
        )
    errors = errors or [np.zeros(level.readings.shape[1:]) for level in captured]
    unknown = ~np.isfinite(np.sum(errors, axis=0))
    levels = [
        Residual(first, second, model, rate_hz, error, unknown)
        for first, second, rate_hz, error in zip(
            captured, expected, model.rates_hz, errors, strict=True
        )
    ]
    # frames and codes
    for level in levels:
        in_time.check_frames(level)
    faults = _merged(levels)
    of_codes = _check_codes(levels)
    faults += of_codes
    # order of the pixels; the dark level of the most counts shows the pattern best
    clearest = max(
        levels, key=lambda level: float(level.expected.readings.sum()) * level.expected.is_dark
    )
    order = readout.arrangement(
        clearest.captured.readings.mean(axis=0), clearest.expected.readings.mean(axis=0)
    )
    for level in levels if order.is_other else ():
        level.captured = level.captured.mapped(order.undone)
    # dead and stuck pixels, which are masked
    masked, unresponsive = pattern.unresponsive(levels)
    _mask(levels, masked)
    faults += unresponsive
    causes, are_dependent = Causes(), False
    if not is_scene:
        # steadiness; of frames that depend on those before, no test that assumes otherwise is made
        dependences = [in_time.check_dependence(level) for level in levels]
        are_dependent = any(dependences)
        if not are_dependent:
            in_time.steady(levels)
        # of uneven codes, readings change as noise of some codes would change them
        is_uneven = any(fault.kind in ("missing codes", "uneven codes") for fault in of_codes)
        for level in levels:
            if is_uneven and not are_dependent:
                level.uncertainty["read noise"] = model.counts_per_code**2
        faults += _merged(levels)
        uneven = pattern.uneven_light([pattern.deviations(level) for level in levels])
        if uneven is not None:
            surface, fault = uneven
            faults.append(fault)
            for level in levels:
                level.subtract((surface * level.parts["efficiency"]).astype(np.float32))
        faults += _check_pixels(levels, are_dependent)
        if not are_dependent:
            causes = find_causes(levels, margin=margin, calibration=_calibration_errors(levels))
    # tests of every pixel that is left
    p_values: dict[str, list[Floats]] = {"mean": [], "variance": []}
    for level in levels:
        recordings = level.captured.readings, level.expected.readings
        sample, reference = (two_sample.Sample.of(readings) for readings in recordings)
        is_tested = level.good & (not are_dependent)
        p = two_sample.mean_test(sample, reference, level.error)
        p_values["mean"].append(np.where(is_tested, p, np.nan))
        p = two_sample.variance_test(sample, reference)
        p_values["variance"].append(np.where(is_tested, p, np.nan))
    rate = FALSE_ALARMS / _FAMILIES
    pixel_tests = {name: two_sample.discoveries(np.array(p), rate) for name, p in p_values.items()}
    return Comparison(order, tuple(faults), causes, causes.alone, pixel_tests, margin)


def _mask(levels: Sequence[Residual], pixels: Mask) -> None:
    for level in levels:
        level.masked = level.masked | pixels


def _check_codes(levels: Sequence[Residual]) -> list[readout.Fault]:
    """Faults of bits and codes of the ADC; stuck bits are put into expected codes."""
    captured, expected = (
        [recording.codes for recording in recordings if recording.codes is not None]
        for recordings in zip(*((level.captured, level.expected) for level in levels), strict=True)
    )
    if not captured or not expected:
        return []
    histograms = readout.code_histograms(captured, expected)
    stuck = readout.stuck_bits(histograms)
    if not stuck:
        return readout.uneven_codes(histograms)
    for level in levels:
        known = level.expected
        if known.codes is not None:
            codes, conditions = known.codes, (known.exposure_s, known.light_hz, known.times_s)
            for bit, is_one in stuck.items():
                mask = codes.dtype.type(1 << bit)
                codes = codes | mask if is_one else codes & ~mask
            level.expected = level_of_codes(codes, level.model.sensor, *conditions)
    return [
        readout.Fault("stuck bit", f"bit {bit} of the ADC is stuck at {int(is_one)}")
        for bit, is_one in stuck.items()
    ]


def _check_pixels(levels: Sequence[Residual], are_dependent: bool) -> list[readout.Fault]:
    """Telegraph noise, lines and single pixels, which are masked, or subtracted."""
    flickering, known = np.zeros((2, *levels[0].masked.shape), np.bool_)
    for level in levels if not are_dependent else ():
        flickering |= correlation(level.captured.signal, level.good).is_telegraph
        known |= correlation(level.expected.signal, level.good).is_telegraph
    _mask(levels, flickering | known)
    has_codes = levels[0].captured.codes is not None
    volts = levels[0].model.volts_per_count if has_codes else 0.0
    offsets, odd, faults = pattern.odd_lines([pattern.deviations(level) for level in levels], volts)
    for counts in offsets:
        for level in levels:
            level.subtract(counts.astype(np.float32))
    _mask(levels, odd)
    alone, of_pixels = pattern.odd_pixels(levels)
    _mask(levels, alone)
    if (flickering & ~known).any():
        text = f"telegraph noise in {readout.pixels_of(flickering & ~known)}"
        faults.append(readout.Fault("telegraph noise", text))
    return faults + of_pixels


def _calibration_errors(levels: Sequence[Residual]) -> dict[str, float]:
    """Relative errors of the array's dark counts and efficiency, of the calibration."""
    errors = {"dark counts": 0.0, "efficiency": 0.0}
    for level in levels:
        good, parameter = level.good, "dark counts" if level.expected.is_dark else "efficiency"
        total = max(float(level.parts["step"][good].sum()), 1e-300)
        share = float(np.sqrt(np.square(level.error[good]).sum())) / total
        errors[parameter] = max(errors[parameter], share)
    return errors


def _merged(levels: Sequence[Residual]) -> list[readout.Fault]:
    """One fault of each kind, with the recordings in which it is seen, of those noted so far."""
    merged = []
    for kind in dict.fromkeys(fault.kind for level in levels for fault in level.faults):
        seen = [level for level in levels if kind in {fault.kind for fault in level.faults}]
        where = f"at {seen[0].captured}" if len(seen) == 1 else (
            f"in {len(seen)} of {len(levels)} recordings"
        )  # fmt: skip
        # of the last recording the first, which is the strongest
        text = next(fault.text for fault in seen[-1].faults if fault.kind == kind)
        merged.append(readout.Fault(kind, f"{text}, {where}"))
    for level in levels:
        level.faults.clear()
    return merged
