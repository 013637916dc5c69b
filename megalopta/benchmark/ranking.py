"""A ranking: the long table of methods on rendered sequences, its record, and its conclusions.

For two groups, such as rotation alone and high parallax, two methods change places if one is better
in the first and the other in the second. The p-value of this is the larger of the two groups' (both
must hold). Of all pairs of methods, numbers of photons and pairs of groups, those accepted by the
rule of Benjamini and Hochberg (1995) count, at a false discovery rate of 5 %.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import combinations, permutations, product
from typing import NamedTuple

import numpy as np
from pydantic import FiniteFloat, NonNegativeInt, PositiveFloat, PositiveInt
from scipy.stats import false_discovery_control

from megalopta.benchmark.block_truths import Opposed, opposed
from megalopta.benchmark.ranking_settings import Pooling, RankingSettings
from megalopta.benchmark.sequence_errors import ERROR, STILL
from megalopta.benchmark.table import Case, Sums, interval, is_larger, ratio, units
from megalopta.core.format_numbers import written
from megalopta.core.record import Record

RATIO = "epe_ratio"
"""Ratio of a method's mean error to a better one's, without pooling, in the compared groups"""

BEST = "surely_best"
"""1 if every other method's interval of the ratio to the method with the lowest mean error is above
1, else 0"""

_FALSE_SHARE = 0.05


class RankingRow(Record, frozen=True):
    """A row of the long table: a value and its 95 % interval."""

    metric: str
    """A metric of `megalopta.benchmark.sequence_errors`, `epe_ratio` or `surely_best`."""
    method: str
    """A method, "zero motion", or the Poisson bound."""
    against: str = ""
    """Method in the denominator of a ratio."""
    photons_per_frame: PositiveFloat
    group: str
    pixels_pooled: PositiveInt
    """Side of the squares of pixels that are added."""
    frames_pooled: PositiveInt
    value: FiniteFloat
    low: FiniteFloat | None = None
    high: FiniteFloat | None = None
    p: FiniteFloat | None = None
    """Two-sided p-value of a ratio of 1."""

    @property
    def case(self) -> Case:
        """Case that the row belongs to."""
        pooling = self.pixels_pooled, self.frames_pooled
        return Case(self.metric, self.method, self.photons_per_frame, self.group, *pooling)


class Ranking(Record, frozen=True):
    """Measurements over all sequences."""

    format: NonNegativeInt = written("ranking")
    """Format of this file (`format_numbers`)"""
    settings: RankingSettings
    sequences: tuple[str, ...]
    frames: PositiveInt
    """Frames of all sequences."""
    frame_px: NonNegativeInt = 0
    """Pixels of a frame of the first sequence; 0 in older files, which do not say."""
    photons_per_lux_s: FiniteFloat
    """Photons per frame on perfect pixels, for each lux and second."""
    blocks: Mapping[str, NonNegativeInt]
    """Blocks of each group without pooling, over all pairs of frames."""
    rows: tuple[RankingRow, ...]

    def row_of(self, case: Case) -> RankingRow | None:
        """Return the row of a case that is no ratio; None if there is none."""
        return self._rows.get((case, ""))

    def error_of(self, pooling: Pooling, flux: float, group: str, method: str) -> RankingRow | None:
        """Return the mean error of a method; None if the group has no blocks."""
        return self.row_of(Case(ERROR, method, flux, group, *pooling))

    def best_of(self, pooling: Pooling, flux: float, group: str) -> RankingRow | None:
        """Return the best method; None if the group has no blocks."""
        return self.row_of(Case(BEST, "", flux, group, *pooling))

    def order_of(self, flux: float, group: str, one: str, other: str) -> RankingRow | None:
        """Return the worse one's ratio to the better one; None if units are too few."""
        cases = (Case(RATIO, name, flux, group, *self.settings.finest) for name in (one, other))
        found = (self._rows.get(key) for key in zip(cases, (other, one), strict=True))
        return next(filter(None, found), None)

    @cached_property
    def _rows(self) -> Mapping[tuple[Case, str], RankingRow]:
        found = {(row.case, row.against): row for row in self.rows}
        best = {row.case._replace(method=""): row for row in self.rows if row.metric == BEST}
        return found | {(case, ""): row for case, row in best.items()}


def ranking_rows(
    parts: Sequence[Mapping[Case, Sums]], settings: RankingSettings, blocks: Mapping[str, int]
) -> Iterator[RankingRow]:
    """Yield the long table from sums over pairs of frames, or numbers, of each sequence."""
    means: dict[Case, Sums] = {}
    for case in dict.fromkeys(case for part in parts for case in part):
        there = [part[case] for part in parts if case in part]
        if case.metric == ERROR:
            means[case] = units(there)
            continue
        values = np.concatenate([each.totals for each in there])
        known = values[~np.isnan(values)]
        if known.size and np.isfinite(middle := np.median(known)):  # blocks without light have none
            yield _row(case, value=float(middle))
    for case, sums in means.items():
        if (mean := interval(sums)) is not None:
            yield _row(case, **mean._asdict())
    yield from _best(means, settings.methods)
    yield from _orders(means, settings, blocks)


def group_blocks(parts: Sequence[Mapping[Case, Sums]], settings: RankingSettings) -> dict[str, int]:
    """Return the number of blocks of each group without pooling."""
    wanted = Case(ERROR, STILL, settings.fluxes[0], "", *settings.finest)
    return {
        case.group: int(sum(part[case].blocks.sum() for part in parts))
        for case in parts[0]
        if case._replace(group="") == wanted
    }


class RankChange(NamedTuple):
    """Two methods that change places."""

    groups: Opposed
    first: RankingRow
    second: RankingRow
    """Ratio of the same methods, inverted"""
    p: float


def changes(ranking: Ranking) -> list[RankChange]:
    """Return the significant changes of order, the smallest p-value first."""
    cases = []
    methods, fluxes = ranking.settings.methods, ranking.settings.fluxes
    for groups, flux in product(opposed(ranking.blocks), fluxes):
        for pair in combinations(methods, 2):
            first, second = (ranking.order_of(flux, name, *pair) for name in groups[:2])
            if first and second:
                turned = first.method != second.method
                p = max(first.p or 0.0, second.p or 0.0) if turned else 1.0
                cases.append(RankChange(groups, first, second, p))
    shares = false_discovery_control([each.p for each in cases])
    kept = (each for each, share in zip(cases, shares, strict=True) if share <= _FALSE_SHARE)
    return sorted(kept, key=lambda each: each.p)


def _best(means: Mapping[Case, Sums], methods: Sequence[str]) -> Iterator[RankingRow]:
    for case in dict.fromkeys(case._replace(method="") for case in means):
        own = {name: means[case._replace(method=name)] for name in (*methods, STILL)}
        if (found := lowest(own)) is not None:
            method, is_sure = found
            yield _row(Case(BEST, method, *case[2:]), value=float(is_sure))


def lowest(sums: Mapping[str, Sums]) -> tuple[str, bool] | None:
    """Return the method of the lowest mean, and True if all others' ratios surely exceed 1.

    None if there are no blocks.
    """
    means = {name: found.value for name, each in sums.items() if (found := interval(each))}
    if not means:
        return None
    first = min(means, key=lambda name: means[name])
    return first, all(is_larger(sums[name], sums[first]) for name in means if name != first)


def _orders(
    means: Mapping[Case, Sums], settings: RankingSettings, blocks: Mapping[str, int]
) -> Iterator[RankingRow]:
    fluxes, methods, finest = settings.fluxes, settings.methods, settings.finest
    groups = dict.fromkeys(name for each in opposed(blocks) for name in each[:2])
    for flux, group, (one, other) in product(fluxes, groups, permutations(methods, 2)):
        worse, better = (Case(ERROR, name, flux, group, *finest) for name in (other, one))
        if (found := ratio(means[worse], means[better])) is None:
            continue
        numbers, p = found
        if numbers.value > 1 or (numbers.value == 1 and one < other):
            yield _row(worse._replace(metric=RATIO), against=one, **numbers._asdict(), p=p)


def _row(case: Case, against: str = "", **numbers: float | None) -> RankingRow:
    fields = case._asdict()
    fields["photons_per_frame"] = fields.pop("photons")
    return RankingRow.model_validate({**fields, "against": against, **numbers})
