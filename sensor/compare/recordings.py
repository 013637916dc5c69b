"""Comparison of a captured and a simulated recording: faults first, then the parameters.

Each step leaves to the next what it cannot explain.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core import bounded
from megalopta.core.arrays import Floats, Mask, mean_and_variance
from megalopta.core.errors import UserError
from megalopta.core.quantities import short, with_error
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.calibrate.pixels import correlation
from megalopta.sensor.calibrate.statistics import statistics
from megalopta.sensor.change import changed
from megalopta.sensor.compare import faults as readout, in_time, pattern, two_sample
from megalopta.sensor.compare.causes import Causes, as_explained, find_causes
from megalopta.sensor.compare.faults import Fault, listed
from megalopta.sensor.compare.left import Left, Whole, left_of_all, strength, unsteady
from megalopta.sensor.compare.model import Model, one_by_one
from megalopta.sensor.compare.residual import Residual
from megalopta.sensor.compare.two_sample import BLOCKS, Difference, PixelTest, Sample
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.measured import MapFile
from megalopta.sensor.spad.model import Sensor

FALSE_ALARMS = 0.01
"""Largest share of comparisons of a device with itself that raise an alarm."""
MARGIN = 0.05
"""Negligible relative difference."""
_FAMILIES = 5
SOFT = ("odd block", "uneven light", "light leak", "hot pixel", "deviating pixel")
"""Faults that are none if much is left that nothing explains"""
_FEWEST_FRAMES = 3 * BLOCKS
_LEAST_SHARE = 0.05
"""Share of what differed, below which parts of the array beside a cause may be what it leaves"""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Differences of two recordings."""

    arrangement: readout.Arrangement
    """Order of the captured pixels"""
    faults: tuple[readout.Fault, ...]
    """Faults found before anything was fitted"""
    explained: Causes
    """Parameters of the device that explain the rest"""
    differences: tuple[Difference, ...]
    """Quantities of the device, or of a scene"""
    tests: Mapping[str, PixelTest]
    """Tests of mean and variance of pixels at all levels, (levels, rows, columns)"""
    margin: float
    """Negligible relative difference"""
    captured: Sequence[Level]
    """Recordings as they were compared frame by frame"""
    expected: Sequence[Level]
    """Simulations of them by the device as calibrated"""
    left: tuple[Left, ...] = ()
    """What no fault explains, before parameters were fitted"""
    compared: Sequence[tuple[Level, Level]] = ()
    """The same without what is named: captured frames, and those simulated again"""

    @property
    def causes(self) -> tuple[Difference, ...]:
        """Quantities that explain the difference and exceed the margin, largest first."""
        real = [cause for cause in self.significant if not cause.is_equivalent]
        return tuple(sorted(real, key=lambda cause: -cause.size))

    @property
    def significant(self) -> list[Difference]:
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
        """Agrees, differs by faults and parameters with their sizes, or unexplained; then why."""
        alternatives = self.explained.accepted[1:]
        or_else = "".join(f", or else {' and '.join(other.names)}" for other in alternatives)
        sizes = [f"{'; '.join(map(str, self.causes))}{or_else} (95 % CI)"] if self.causes else []
        differs = "; ".join([*self._faults, *sizes])
        if differs:
            rest = f", and in something else: {_NONE}" if self.explained.is_unexplained else ""
            verdict = f"Captured and simulated frames differ: {differs}{rest}."
        elif self.explained.is_unexplained:
            verdict = f"Captured and simulated frames differ; {_NONE}."
        elif not self.differences:
            verdict = "Neither parameters nor pixels can be compared."
        elif self.alarms:
            verdict = f"Differences are statistically significant but small: {self.alarms[0]}."
        else:
            verdict = f"{agreement('frames', self.differences)}."
        verdict = re.sub(r"\((\d+), (\d+)\)", r"(row \1, column \2)", verdict, count=1)
        return " ".join([verdict, *self._evidence])

    @property
    def _evidence(self) -> list[str]:
        """Gain in predicting other frames, or the largest of what is left."""
        if any(fault.kind == "light" for fault in self.faults):
            return ["Check light (photons per second on a pixel), exposure and wavelength."]
        if (gain := self.explained.gain) > 2:
            names = " and ".join(self.explained.accepted[0].names)
            times = f"{gain:.0f} times" if gain < 1000 else "over 1000 times"
            return [f"With this {names}, frames kept from the fit are predicted {times} better."]
        if not (self.explained.is_unexplained and self.left):
            return []
        largest = max(self.left, key=lambda one: one.z)
        return [f"Most is left of this: {largest.name} ({largest.level}; {largest.z:.0f} σ)."]


_NONE = "none of the known causes explains the difference"


def agreement(what: str, differences: Sequence[Difference]) -> str:
    """Return that nothing differs, within which interval, and what is too uncertain to tell."""
    relative = [change for change in differences if not change.base]
    equal = [change for change in relative if change.is_equivalent]
    open_ = [change.name for change in differences if not change.is_equivalent]
    text = f"Captured and simulated {what} agree: no difference is statistically significant"
    if equal:
        bounds = sorted((100 * max(abs(one.low), abs(one.high)), one.name) for one in equal)
        texts = [f"{with_error(bound, 0, '%')} ({name})" for bound, name in bounds]
        text += f"; equal within {', '.join(texts)} (95 % CI)"
    return text + (f"; too uncertain to tell: {', '.join(open_)}" if open_ else "")


def compare_recordings(
    captured: Sequence[Level], device: Sensor, *, wavelength_nm: float | None = None,
    margin: float = MARGIN, seed: int = 0,
) -> Comparison:  # fmt: skip
    """Compare recordings in the dark and under uniform light with simulations of a device.

    Raises ValueError if they differ in shape, have too few frames or never change.

    Parameters
    ----------
    captured
        Counts of one array at every light and exposure, or of ADC codes `level_of_codes`. Of more
        than 2²⁴ readings, the first frames are compared one by one, and the moments of all.
    device
        As `load_sensor` reads it. Errors of a calibration are taken from next to its maps.
    wavelength_nm
        Wavelength of the light, which is given as photons per second on a pixel.
    margin
        Negligible relative difference.
    seed
        Seed of the simulation.

    Returns
    -------
    Comparison
        Its `sentence` tells what differs, by how much and why.

    Examples
    --------
    >>> from megalopta.sensor import preset
    >>> draw = np.random.default_rng(0).poisson
    >>> levels = [Level(draw(counts, (100, 8, 8)), 1e-4, 1e4 * counts) for counts in (4, 40)]
    >>> compare_recordings(levels, preset("ideal"), wavelength_nm=550).sentence
    'Captured and simulated frames agree: no difference is statistically significant; ...'
    """
    if wavelength_nm is None and any(level.light_hz for level in captured):
        raise ValueError("wavelength_nm: unknown; give that of the light (--wavelength-nm)")
    rates = []
    for level in captured:
        shape, nm = (level.readings.shape[1], level.readings.shape[2]), np.array(wavelength_nm or 0)
        sensor = changed(device, exposure_s=level.exposure_s)
        per_photon = sensor.photon_detection_efficiency(nm)
        factor = draw_fixed_pattern(sensor, shape).efficiency_factor
        rates.append(level.light_hz * float(per_photon) * factor[np.newaxis])
    model, levels_and_rates = Model(device, rates), zip(captured, rates, strict=True)
    errors = [rate_errors(device, rate) * level.exposure_s for level, rate in levels_and_rates]
    simulated = model.drawn(captured, seed)
    return compare_levels(captured, simulated, model, margin=margin, errors=errors)


def rate_errors(device: Sensor, rates_hz: Floats) -> Floats:
    """Return standard errors of mean rates (rows, columns) due to those of the maps, Hz."""
    maps, shape = device.measured, (rates_hz.shape[1], rates_hz.shape[2])
    factor = np.maximum(draw_fixed_pattern(device, shape).efficiency_factor, 1e-12)
    of_light = rates_hz.mean(axis=0) * _map_error(maps.efficiency) / factor
    return np.asarray(np.hypot(_map_error(maps.dark_counts), of_light))


def _map_error(file: MapFile | None) -> Floats | float:
    """Standard errors of a map, from the intervals next to it; 0 without, NaN if unknown."""
    if file is None:
        return 0.0
    path, ends = Path(file.path), []
    for end in ("low", "high"):
        beside = path.with_name(f"{path.stem}_{end}.npy")
        if not beside.exists():
            return 0.0
        values = bounded.plain_array(bounded.read_bytes(beside, bounded.ARRAY_BYTES))
        if values is None or values.ndim != 2:
            raise UserError(
                f"{beside} is not a complete array of numbers; calibrate the device again"
            )
        ends.append(values.astype(np.float64))
    return np.asarray((ends[1] - ends[0]) / (2 * 1.959964))  # of a 95 % CI


def compare_levels(
    captured: Sequence[Level], expected: Sequence[Level], model: Model, *, margin: float = MARGIN,
    errors: Sequence[Floats] | None = None, is_scene: bool = False,
) -> Comparison:  # fmt: skip
    """Compare the same levels in the same order; numbers of frames may differ.

    The expected recordings are of the model; `errors` are standard errors of their mean counts
    (rows, columns), if from a calibration, NaN for pixels that it does not know, which are masked.
    Of a scene, whose light changes, neither steadiness nor parameters are tested. Raises ValueError
    if levels differ in shape, have too few frames or never change.
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
    whole = [
        None if is_scene or one_by_one(level) is level else Whole.of(level.signal)
        for level in captured
    ]
    captured = captured if is_scene else [one_by_one(level) for level in captured]
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
    wrong = [] if is_scene else _wrong_lights(levels)
    order, faults = _faults_of_readout(levels)
    causes, left = Causes(), list[Left]()
    if wrong:  # of which bits that never change are no fault
        faults = wrong
    elif not is_scene:
        levels, faults, causes, left = _explained(levels, whole, faults, margin)
    is_tested = causes.p_forgiven < 1 or is_scene
    # what was taken out of some frames is still in all of them
    samples = [
        all_.pixels if all_ and level.captured is first else Sample.of(level.captured.readings)
        for all_, level, first in zip(whole, levels, captured, strict=True)
    ]
    tests = _pixel_tests(levels, samples, is_tested)
    named = tuple(fault for fault in faults if fault.kind != "none")
    compared = [(level.captured, level.expected) for level in levels if not wrong]
    compared = compared or list(zip(captured, expected, strict=True))
    return Comparison(
        order, named, causes, causes.alone, tests, margin, captured, expected, tuple(left), compared
    )


def _explained(
    levels: list[Residual], whole: Sequence[Whole | None], faults: list[Fault], margin: float
) -> tuple[list[Residual], list[Fault], Causes, list[Left]]:
    """Find faults in time, then parameters and parts of the array; return what is left, too."""
    changes = _faults_in_time(levels)
    left = [statistic for level in levels for statistic in unsteady(level)]
    # pixels of lines that are copies for a while, or that flicker with others, are no traps
    is_shared = any(fault.kind.startswith("copied") for fault in faults)
    is_shared |= "time of pixels, a line" in {statistic.name for statistic in left}
    faults = faults + [f for f in changes if not (is_shared and f.kind == "telegraph noise")]
    for level, all_frames in zip(levels, whole, strict=True) if not faults else ():
        left += all_frames.unsteady(level.captured) if all_frames else []
    # of frames that depend on those before, or change, nothing is tested that assumes otherwise
    kinds = {fault.kind for fault in faults}
    if "lag" in kinds or "none" in kinds or left:
        left = [] if "lag" in kinds else left
        return levels, faults, Causes(is_unexplained=bool(left) or "none" in kinds), left
    errors = _calibration_errors(levels)
    causes, least_gain = find_causes(levels, margin=margin, calibration=errors), 0.0
    if causes.accepted:
        least_gain = _LEAST_SHARE * strength(left_of_all(levels))
        levels = [as_explained(level, causes.accepted[0]) for level in levels]
    patterns, gain = pattern.check_patterns(levels, least_gain)
    alone, of_pixels = pattern.odd_pixels(levels)
    _mask(levels, alone)
    in_space, left = patterns + of_pixels, left_of_all(levels)
    is_none = "none" in {fault.kind for fault in in_space}
    if not causes.accepted and (in_space or left):
        errors, is_left = _calibration_errors(levels), bool(left) or is_none
        causes = find_causes(levels, margin=margin, calibration=errors, is_left=is_left)
        if causes.accepted:
            levels = [as_explained(level, causes.accepted[0]) for level in levels]
    is_much = is_none or causes.is_different or strength(left) > max(0.05 * gain, 100.0)
    faults = faults + in_space
    if causes.is_unexplained and is_much:
        faults = [fault for fault in faults if fault.kind not in SOFT]
    return levels, faults, causes, [] if causes.accepted else left


def _faults_of_readout(levels: Sequence[Residual]) -> tuple[readout.Arrangement, list[Fault]]:
    """Order of the pixels, and faults that readings show exactly, which are taken out."""
    for level in levels:
        in_time.check_frames(level)
    unresponsive_pixels, unresponsive = pattern.unresponsive(levels)
    _mask(levels, unresponsive_pixels)
    faults = _merged(levels) + unresponsive
    copied = False
    for level in levels:
        in_time.check_parts(level)
    faults += _merged(levels)
    for level in levels:
        first, second = (_few(frames.recorded) for frames in (level.captured, level.expected))
        masked, copies = readout.copied_lines(first, second, level.good)
        _mask(levels, masked)
        faults += [fault for fault in copies if fault.kind not in {known.kind for known in faults}]
        copied |= bool(copies)
    # the dark level of the most counts shows the pattern best
    clearest = max(
        levels, key=lambda level: float(level.expected.readings.sum()) * level.expected.is_dark
    )
    order = readout.arrangement(
        *(frames.recorded.mean(axis=0) for frames in (clearest.captured, clearest.expected))
    )
    for level in levels if order.is_other and not copied else ():
        level.reorder(order.undone)
    if order.is_other:
        _mask(levels, np.asarray(order.undone(unresponsive_pixels[None])[0]))
    of_readings = _check_readings(levels)
    if of_readings:  # which may look like pixels that never change
        faults = [fault for fault in faults if fault not in unresponsive]
        faults += pattern.unresponsive(levels)[1]
    return order, faults + of_readings


def _wrong_lights(levels: Sequence[Residual]) -> list[Fault]:
    """Say which levels have ten times the expected counts, or a tenth, with the noise of events."""
    texts, off = list[str](), set[tuple[bool, bool]]()
    for level in levels:
        frames, one = level.captured, 1 / len(level.captured.readings)
        dark = level.model.moments(frames.exposure_s, np.zeros_like(level.light_hz))[0]
        maps = *mean_and_variance(frames.signal), level.parts["step"], dark
        seen, noise, usual, least = (max(float(part[level.good].sum()), one) for part in maps)
        is_far = max(seen, usual) > max(10 * min(seen, usual), 1000 * one)
        if is_far and 0.03 < noise / seen < 2:
            off.add((frames.is_dark, seen > usual))
            ratio = (seen - least) / (usual - least) if seen > usual > least else seen / usual
            size = short(float(f"{max(ratio, 1 / ratio):.1e}"))
            texts.append(f"{f'{size} times' if ratio > 1 else f'1/{size}'} as many ({frames})")
    text = f"counts are not those of the stated light, but {listed(texts)}"
    # more counts in the dark, too, are of another temperature or exposure
    is_light = (False, False) in off or ((False, True) in off and (True, True) not in off)
    return [Fault("light", text)] if is_light else []


def _faults_in_time(levels: Sequence[Residual]) -> list[Fault]:
    """Faults in time, which are taken out."""
    for level in levels:
        in_time.check_odd_frames(level)
    in_time.check_changes(levels)
    lags = [in_time.check_lag(level) for level in levels]
    unknown = any(fault.kind == "none" for level in levels for fault in level.faults)
    if not any(lags) and not unknown:
        in_time.check_noise(levels)
    faults = _merged(levels)
    if any(lags):  # the first frame has none before
        return [fault for fault in faults if not fault.text.startswith(in_time.FIRST)]
    return faults + _check_telegraph(levels)


def _pixel_tests(
    levels: Sequence[Residual], captured: Sequence[Sample], is_tested: bool
) -> dict[str, PixelTest]:
    """Test mean and variance of every pixel that is left."""
    parts: dict[str, list[tuple[Floats, Mask]]] = {"mean": [], "variance": []}
    for level, first in zip(levels, captured, strict=True):
        second = Sample.of(level.expected.readings)
        good = level.good & is_tested
        p = two_sample.mean_test(first, second, np.hypot(level.error, level.doubted))
        parts["mean"].append((np.where(good, p, np.nan), first.mean > second.mean))
        p = two_sample.variance_test(first, second, level.error)
        parts["variance"].append((np.where(good, p, np.nan), first.variance > second.variance))
    rate = FALSE_ALARMS / _FAMILIES
    return {name: two_sample.discoveries(of, rate) for name, of in parts.items()}


def _few(readings: NDArray[Any]) -> NDArray[Any]:
    """Frames of big arrays that are enough for distributions and copies: 2²² readings."""
    return readings[: max(2**22 // max(readings[0].size, 1), 16)]


def _mask(levels: Sequence[Residual], pixels: Mask) -> None:
    for level in levels:
        level.masked = level.masked | pixels


def _check_readings(levels: Sequence[Residual]) -> list[Fault]:
    """Faults of the range, bits and codes of readings; the expected ones get the same."""
    captured, expected = (
        [getattr(level, side).recorded for level in levels] for side in ("captured", "expected")
    )
    if any(readings.dtype.kind not in "iu" for readings in (*captured, *expected)):
        return []
    good = ~levels[0].masked
    faults = []
    few = [list(map(_few, readings)) for readings in (captured, expected)]
    for fault, spoil in readout.range_of(few[0], few[1], good):
        faults.append(fault)
        for level in levels:
            level.read_out(spoil)
    expected = [level.expected.recorded for level in levels]
    bits = readout.Bits.of(captured, expected)
    if stuck := bits.faults(good):
        for level in levels:
            level.read_out(bits.put)
        return faults + stuck
    faults = faults or readout.uneven_codes(captured, expected)
    for level in levels if faults else ():
        # readings change as noise of some codes would change them
        level.uncertainty["read noise"] = level.model.counts_per_code**2
        level.quiet.add("bit")
    return faults


def _check_telegraph(levels: Sequence[Residual]) -> list[Fault]:
    """Telegraph noise of single pixels, which are masked."""
    flickering, known = np.zeros((2, *levels[0].masked.shape), np.bool_)
    for level in levels:
        flickering |= correlation(statistics(level.captured.signal), level.good).is_telegraph
        known |= correlation(statistics(level.expected.signal), level.good).is_telegraph
    _mask(levels, flickering | known)
    new = flickering & ~known
    if not new.any():
        return []
    series = [np.asarray(level.captured.signal[:, new], np.float32) for level in levels]
    if new.sum() > max(0.03 * new.size, 8) or any(_move_together(part) for part in series):
        return [Fault("none", f"{new.sum()} pixels fluctuate slowly")]
    return [Fault("telegraph noise", f"telegraph noise in {readout.pixels_of(new)}")]


def _move_together(series: NDArray[Any]) -> bool:
    """Return whether pixels (n, P) change slowly and together, as no traps do."""
    slow = np.array([part.mean(axis=0) for part in np.array_split(series, len(series) // 8)])
    slow -= slow.mean(axis=0)
    size = np.sqrt(np.square(slow).sum(axis=0))
    slow = slow[:, size > 0] / size[size > 0]
    many = slow.shape[1]
    alike = np.square(slow.T @ slow).sum() - many
    return many > 2 and bool(alike / (many * (many - 1)) > 0.2)


def _calibration_errors(levels: Sequence[Residual]) -> dict[str, float]:
    """Relative errors of the array's dark counts and efficiency, of the calibration."""
    errors = {"dark counts": 0.0, "efficiency": 0.0}
    for level in levels:
        good, parameter = level.good, "dark counts" if level.expected.is_dark else "efficiency"
        total = max(float(level.parts["step"][good].sum()), 1e-300)
        share = float(np.sqrt(np.square(level.error[good]).sum())) / total
        errors[parameter] = max(errors[parameter], share)
    return errors


def _merged(levels: Sequence[Residual]) -> list[Fault]:
    """One fault of each kind, with the recordings in which it is seen, of those noted so far."""
    merged = []
    for kind in dict.fromkeys(fault.kind for level in levels for fault in level.faults):
        seen = [level for level in levels if kind in {fault.kind for fault in level.faults}]
        where = f"at {seen[0].captured}" if len(seen) == 1 else (
            f"in {len(seen)} of {len(levels)} recordings"
        )  # fmt: skip
        # of the last recording the first, which is the strongest
        text = next(fault.text for fault in seen[-1].faults if fault.kind == kind)
        merged.append(Fault(kind, f"{text}, {where}"))
    for level in levels:
        level.faults.clear()
    return merged
