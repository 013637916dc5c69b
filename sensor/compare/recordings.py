"""A captured recording against a simulated one, in all respects, with one false-alarm rate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.order import Arrangement, arrangement
from megalopta.sensor.compare.quantities import (
    BANDS,
    BLOCKS,
    band_powers,
    block_quantities,
    unsure_quantities,
)
from megalopta.sensor.compare.two_sample import (
    Difference,
    Distances,
    PixelTest,
    Quantity,
    difference,
    discoveries,
    distances_by_chance,
    histogram_test,
    mean_test,
    variance_test,
)

FALSE_ALARMS = 0.01
"""Share of comparisons of a device with itself that raise an alarm, at most."""
MARGIN = 0.05
"""Relative difference that does not matter."""
_QUANTITIES = (
    Quantity("step", "counts per event"),
    Quantity("crosstalk", "neighbors per event", least=0.02),
    Quantity("dark counts", "Hz"),
    Quantity("efficiency", "events per photon"),
    Quantity("dead time", "s", least=1e-9),
)
_FAMILIES = 5
_FEWEST_FRAMES = 3 * BLOCKS


@dataclass(frozen=True, eq=False)
class Comparison:
    """Differences of two recordings."""

    arrangement: Arrangement
    """In which order the captured pixels are"""
    differences: tuple[Difference, ...]
    """Quantities of the device"""
    tests: Mapping[str, PixelTest]
    """Of mean, variance and histogram of pixels at all levels, (levels, rows, columns)"""
    distances: Distances
    """Between histograms, (levels, rows, columns), and those of samples of one law"""
    by_chance: Distances
    spectrum: tuple[Difference, ...]
    """Shares of bands of frequency"""
    margin: float

    @property
    def causes(self) -> tuple[Difference, ...]:
        """Quantities that differ beyond chance and by more than the margin, largest first."""
        real = [each for each in beyond_chance(self.differences) if not each.is_equivalent]
        return tuple(sorted(real, key=lambda each: -each.size))

    @property
    def alarms(self) -> tuple[str, ...]:
        """Sentences on everything that differs beyond chance."""
        found = []
        if self.arrangement.is_other:
            found.append(f"the captured image is {self.arrangement.name}")
        found += map(str, beyond_chance(self.differences))
        for name, test in self.tests.items():
            if test.differs.any():
                many = f"{test.differs.sum()} of {np.isfinite(test.p).sum()}"
                found.append(f"the {name} differs in {many} pixels")
        return (*found, *map(str, beyond_chance(self.spectrum)))

    @property
    def sentence(self) -> str:
        """Summary: what differs and by how much."""
        if self.arrangement.is_other:
            return (
                f"The captured image is {self.arrangement.name}: rank correlation "
                f"{self.arrangement.correlation:.2f} so, {self.arrangement.as_it_is:.2f} as it is."
            )
        if self.causes:
            return f"Captured: {'; '.join(map(str, self.causes))}."
        if not self.alarms:
            return "Nothing differs beyond chance."
        largest = max(self.differences, key=lambda each: each.size, default=None)
        first = self.alarms[0]
        limit = f"; of the device, at most: {largest}" if largest and str(largest) != first else ""
        return f"Differences are beyond chance but small: {first}{limit}."


def beyond_chance(tested: Sequence[Difference]) -> list[Difference]:
    """Return those that differ, of one family of tests."""
    limit = FALSE_ALARMS / _FAMILIES / max(len(tested), 1)
    return [each for each in tested if each.p < limit]


def compare_recordings(
    captured: Sequence[Level],
    expected: Sequence[Level],
    *,
    kind: str = "paralyzable",
    margin: float = MARGIN,
    errors: Sequence[Floats | float] | None = None,
) -> Comparison:
    """Compare level by level.

    Raises ValueError when levels are not of the same shape, or have too few frames.

    `captured`, `expected` sequences of Level: the same levels in the same order; numbers of
    frames may differ; `kind`: dead time of the device; `margin`: relative difference that does not
    matter; `errors` sequence of (rows, columns): standard errors of the expected mean counts of
    each level, where these are a calibration's.
    """
    _check(captured, expected)
    pairs = list(zip(captured, expected, strict=True))
    usable = [one.usable & other.usable for one, other in pairs]
    unsure = errors or [0.0] * len(pairs)
    p_values, distances, chance = [], [], []
    for (one, other), good, error in zip(pairs, usable, unsure, strict=True):
        a, b = np.asarray(one.readings, np.float64), np.asarray(other.readings, np.float64)
        of_histograms, apart = histogram_test(a, b)
        tests = mean_test(a, b, error), variance_test(a, b), of_histograms
        p_values.append([np.where(good, p, np.nan) for p in tests])
        distances.append(apart)
        chance.append(distances_by_chance(a, b))
    first, second = (block_quantities(each, usable, kind) for each in (captured, expected))
    known = unsure_quantities(expected, usable, unsure)
    families = zip(("mean", "variance", "histogram"), zip(*p_values, strict=True), strict=True)
    return Comparison(
        arrangement=_arrangement(pairs),
        differences=tuple(
            difference(each, first[each.name], second[each.name], margin, known.get(each.name, 0.0))
            for each in _QUANTITIES
            if each.name in first and each.name in second
        ),
        tests={name: discoveries(np.array(p), FALSE_ALARMS / _FAMILIES) for name, p in families},
        distances=_stacked(distances),
        by_chance=_stacked(chance),
        spectrum=_spectrum(pairs, margin),
        margin=margin,
    )


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
    """Arrangement by the level that shows the pattern best, the one of the most counts."""
    one, other = max(pairs, key=lambda each: float(each[1].readings.sum()) * each[1].is_dark)
    return arrangement(one.readings.mean(axis=0), other.readings.mean(axis=0))


def _spectrum(pairs: Sequence[tuple[Level, Level]], margin: float) -> tuple[Difference, ...]:
    found = []
    for at, (one, other) in enumerate(pairs):
        a, b = band_powers(one.readings), band_powers(other.readings)
        if min(len(a), len(b)) < 4:
            continue
        for band in range(BANDS - 1):
            power = Quantity(f"power of band {band + 1} at level {at + 1}")
            found.append(difference(power, a[:, band], b[:, band], margin))
    return tuple(found)
