"""Comparison of a captured and a simulated recording, with one overall false-alarm rate.

**Order of the pixels**: rotated, mirrored, or with rows swapped. The fixed pattern of a device is
its fingerprint. Spearman's rank correlation of two maps measures whether bright pixels agree; it is
insensitive to gain, offset and hot pixels. Candidates are the 8 symmetries of the square and the
best-matching order of rows (assignment by correlation). The one with a clearly higher correlation
is named.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist
from scipy.stats import rankdata

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.level import Level
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
"""Largest share of comparisons of a device with itself that raise an alarm."""
MARGIN = 0.05
"""Negligible relative difference."""
_QUANTITIES = (
    Quantity("step", "counts per event"),
    Quantity("crosstalk", "neighbors per event", least=0.02),
    Quantity("dark counts", "Hz"),
    Quantity("efficiency", "events per photon"),
    Quantity("dead time", "s", least=1e-9),
)
_FAMILIES = 5
_FEWEST_FRAMES = 3 * BLOCKS
_CLEARLY = 6.0
_SYMMETRIES = {
    "neither turned nor mirrored": (False, 0),
    "turned by 90° to the right": (False, 1),
    "turned by 180°": (False, 2),
    "turned by 90° to the left": (False, 3),
    "transposed": (True, 0),
    "mirrored, its rows in reverse order": (True, 1),
    "transposed about the other diagonal": (True, 2),
    "mirrored, its columns in reverse order": (True, 3),
}


class Arrangement(NamedTuple):
    """Rearrangement under which a map resembles another one."""

    name: str
    correlation: float
    """Rank correlation after rearranging."""
    as_it_is: float
    """Rank correlation before rearranging."""
    rows: tuple[int, ...] | None = None
    """Row of the captured map at each place, if rows are swapped."""

    @property
    def is_other(self) -> bool:
        """True if anything is swapped."""
        return self.name != "neither turned nor mirrored"


@dataclass(frozen=True, eq=False)
class Comparison:
    """Differences of two recordings."""

    arrangement: Arrangement
    """Order of the captured pixels"""
    differences: tuple[Difference, ...]
    """Quantities of the device"""
    tests: Mapping[str, PixelTest]
    """Tests of mean, variance and histogram of pixels at all levels, (levels, rows, columns)"""
    distances: Distances
    """Distances between histograms, (levels, rows, columns), and of samples of one distribution"""
    by_chance: Distances
    spectrum: tuple[Difference, ...]
    """Shares of frequency bands"""
    margin: float

    @property
    def causes(self) -> tuple[Difference, ...]:
        """Quantities that differ significantly and by more than the margin, largest first."""
        real = [each for each in beyond_chance(self.differences) if not each.is_equivalent]
        return tuple(sorted(real, key=lambda each: -each.size))

    @property
    def alarms(self) -> tuple[str, ...]:
        """Sentences on every significant difference."""
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
        """Summary of the differences and their size."""
        if self.arrangement.is_other:
            return (
                f"The captured image is {self.arrangement.name}: rank correlation rearranged "
                f"{self.arrangement.correlation:.2f}, before {self.arrangement.as_it_is:.2f}."
            )
        if self.causes:
            return f"Captured: {'; '.join(map(str, self.causes))}."
        if not self.alarms:
            return "No difference is statistically significant."
        largest = max(self.differences, key=lambda each: each.size, default=None)
        first = self.alarms[0]
        limit = f"; of the device, at most: {largest}" if largest and str(largest) != first else ""
        return f"Differences are statistically significant but small: {first}{limit}."


def beyond_chance(tested: Sequence[Difference]) -> list[Difference]:
    """Return the significant differences of one family of tests."""
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
    """Compare recordings level by level.

    Raises ValueError if levels differ in shape or have too few frames.

    `captured`, `expected` sequences of Level: the same levels in the same order; numbers of frames
    may differ; `kind`: kind of dead time; `margin`: negligible relative difference; `errors`
    sequence of (rows, columns): standard errors of each level's expected mean counts, if from a
    calibration.
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


def arrangement(captured: Floats, expected: Floats) -> Arrangement:
    """Find the rearrangement of a map (rows, columns) relative to the expected one."""
    plain = _correlation(captured, expected)
    best = Arrangement("neither turned nor mirrored", plain, plain)
    for name, (is_transposed, turns) in _SYMMETRIES.items():
        turned = np.rot90(captured.T if is_transposed else captured, turns)
        if turned.shape == expected.shape:
            found = _correlation(turned, expected)
            if _is_clearly_higher(found, best.correlation, captured.size):
                best = Arrangement(name, found, plain)
    rows = matching_rows(captured, expected)
    swapped = _correlation(captured[rows], expected)
    moved = int((rows != np.arange(len(rows))).sum())
    # with so many orders one fits by chance: the best of n normal correlations of two rows
    by_chance = float(np.sqrt(2 * np.log(len(rows)) / max(captured.shape[1] - 1, 1)))
    if (
        moved
        and swapped > by_chance
        and _is_clearly_higher(swapped, best.correlation, captured.size)
    ):
        name = f"{moved} of {len(rows)} rows in another order"
        return Arrangement(name, swapped, plain, tuple(int(row) for row in rows))
    return best


def matching_rows(captured: Floats, expected: Floats) -> NDArray[np.intp]:
    """Return the captured row (rows,) most similar to each expected one, each used once."""
    ranks = [rankdata(each).reshape(each.shape) for each in (captured, expected)]
    apart = cdist(ranks[1], ranks[0], "sqeuclidean")
    return np.asarray(linear_sum_assignment(apart)[1])


def _correlation(one: Floats, other: Floats) -> float:
    ranks = [rankdata(each) - (each.size + 1) / 2 for each in (one, other)]
    norm = np.sqrt((ranks[0] ** 2).sum() * (ranks[1] ** 2).sum())
    return float((ranks[0] * ranks[1]).sum() / norm) if norm > 0 else 0.0


def _is_clearly_higher(one: float, other: float, pixels: int) -> bool:
    """Fisher's z test; a map of 256 pixels has a standard error of 0.09."""
    z = np.arctanh(np.clip([one, other], -0.999999, 0.999999))
    return bool((z[0] - z[1]) * np.sqrt((pixels - 3) / 2) > _CLEARLY)


def _arrangement(pairs: Sequence[tuple[Level, Level]]) -> Arrangement:
    """Arrangement from the level with the most counts, which shows the pattern best."""
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
