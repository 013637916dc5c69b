"""A ranking: its settings, the long table of methods on rendered sequences, and its conclusions.

For two groups, such as rotation alone and high parallax, two methods change places if one is better
in the first and the other in the second. The p-value of this is the larger of the two groups' (both
must hold). Of all pairs of methods, numbers of photons and pairs of groups, those accepted by the
rule of Benjamini and Hochberg (1995) count, at a false discovery rate of 5 %.
"""

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, permutations, product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import pandas as pd
from pydantic import Field, FiniteFloat, NonNegativeInt, PositiveInt, model_validator
from scipy.stats import false_discovery_control

from megalopta.benchmark import table
from megalopta.config.model import LightLevel, LightLevels
from megalopta.config.scene import ONCE
from megalopta.core import bounded, files
from megalopta.core.arrays import Floats
from megalopta.core.format_numbers import check_format, written
from megalopta.core.record import Record
from megalopta.flow.detectors.registry import VELOCITY_METHODS
from megalopta.flow.stimuli.photons import resize
from megalopta.scenes.levels import illuminance_of

Flux = Annotated[float, Field(gt=0)]
Frames = Annotated[int, Field(ge=1)]


class Pooling(NamedTuple):
    """Pixels along a side, and frames, that are added."""

    pixels: int
    frames: int

    def __str__(self) -> str:
        """Describe it as text."""
        return f"{self.pixels} × {self.pixels} px, {self.frames} frame{'s'[: self.frames > 1]}"

    def light(self, light: Floats) -> Floats:
        """Add the light (T, H, W) of neighbors; excess frames and pixels are cut."""
        count = len(light) // self.frames
        kept = light[: count * self.frames].reshape(count, self.frames, *light.shape[1:])
        return resize(kept.sum(axis=1), self.shape((light.shape[1], light.shape[2])), "area")

    def shape(self, shape: tuple[int, int]) -> tuple[int, int]:
        """Return the pixels (H, W) of pooled frames."""
        return max(1, shape[0] // self.pixels), max(1, shape[1] // self.pixels)

    def steps(self, frames: int) -> Iterator[slice]:
        """Yield, for each pair of pooled frames, the steps from the middle of one to the next."""
        middle = (self.frames - 1) // 2
        for first in range(middle, frames // self.frames * self.frames - self.frames, self.frames):
            yield slice(first, first + self.frames)


class RankingSettings(Record, frozen=True):
    """Methods, photons and pooling."""

    methods: Annotated[tuple[str, ...], ONCE, Field(min_length=1)] = VELOCITY_METHODS
    """Methods that give velocities: names, `module:function`, or ONNX files."""
    fluxes: Annotated[tuple[Flux, ...], ONCE] = (1e3, 1e4, 1e5, 1e6, 1e7, 1e8)
    """Photons per frame, summed over all pixels."""
    light_levels: LightLevels = ()
    """Further light levels, by name or in lux; their photons per frame are added to fluxes."""
    exposure_s: Annotated[float, Field(gt=0, le=1000)] = 0.01
    """Exposure of a frame at these levels (s)."""
    repeats: Annotated[int, Field(ge=1)] = 2
    """Independent photon draws per sequence."""
    pixels_pooled: Annotated[tuple[Frames, ...], ONCE, Field(min_length=1)] = (1, 2)
    """Sides of the squares of pixels whose photons are added (px)."""
    frames_pooled: Annotated[tuple[Frames, ...], ONCE, Field(min_length=1)] = (1, 2)
    """Successive frames whose photons are added."""
    seed: int = 0
    """Seed of the photons."""

    @property
    def finest(self) -> Pooling:
        """Pooling of the fewest pixels and frames."""
        return Pooling(min(self.pixels_pooled), min(self.frames_pooled))

    @property
    def poolings(self) -> list[Pooling]:
        """All poolings."""
        return [Pooling(p, f) for p in self.pixels_pooled for f in self.frames_pooled]

    @model_validator(mode="after")
    def _has_light(self) -> "RankingSettings":
        if not self.fluxes and not self.light_levels:
            raise ValueError("give fluxes, or light_levels")
        return self


def photons_at(per_lux_s: float, level: LightLevel, exposure_s: float) -> float:
    """Photons of a mean frame at a level, in the rendered color; four digits."""
    return float(f"{per_lux_s * illuminance_of(level) * exposure_s:.4g}")


MEAN, MEDIAN, FAR = "epe_px", "median_epe_px", "share_beyond_3_px"
"""Metrics of the endpoint errors of blocks: mean; median of a pair of frames, mean over pairs;
share of blocks off by more than 3 px"""

RATIO = "epe_ratio"
"""Ratio of a method's mean error to a better one's, without pooling, in the compared groups"""

STILL = "zero motion"
"""Baseline that a method must beat: no motion anywhere"""

BOUND = "Poisson bound"

RANGES = ("low", "medium", "high")
ALONE, LITTLE, MUCH, HIDDEN = "rotation alone", "low parallax", "high parallax", "hidden"
"""Visible blocks of sequences of rotation alone; visible blocks of other sequences with low or high
parallax; hidden blocks of other sequences"""

COLUMNS = [*table.CASE, "value", "low", "high", "surely_lowest", "against", "p"]
"""Columns of the long table: `surely_lowest` is true if the value is lower than that of every other
method; of ratios, `against` is the method in the denominator, p the two-sided p-value of 1"""

FEWEST_SEQUENCES = 5
"""Least number of sequences for sequences to be the units"""
SEGMENTS = 10
"""Segments of successive pairs of frames per sequence, if sequences are fewer"""

_FALSE_SHARE = 0.05


class Opposed(NamedTuple):
    """Two groups between which the order of methods may change, and the property that differs."""

    one: str
    other: str
    what: str


def at_speed(speed: str, kind: str) -> str:
    """Name of the group of blocks of one kind at low, medium or high speed."""
    return f"{kind}, speed {speed}"


def opposed(blocks: Mapping[str, int]) -> list[Opposed]:
    """Return the groups to compare, of equal speed if possible.

    Parallax and occlusion are compared with rotation alone if there are such sequences, otherwise
    with low parallax.
    """
    before = ALONE if any(blocks.get(at_speed(speed, ALONE)) for speed in RANGES) else LITTLE
    by_speed = [
        Opposed(at_speed(speed, before), at_speed(speed, after), what)
        for after, what in ((MUCH, "parallax"), (HIDDEN, "occlusion"))
        for speed in RANGES
    ]
    return [
        *by_speed,
        Opposed("smooth", "depth edge", "depth edges"),
        Opposed("speed low", "speed high", "speed"),
    ]


class RankingFacts(Record, frozen=True):
    """What was measured: `ranking.json`."""

    format: NonNegativeInt = written("ranking")
    """Format of this file (`format_numbers`)"""
    settings: RankingSettings
    sequences: tuple[str, ...]
    frames: PositiveInt
    """Frames of all sequences."""
    frame_px: PositiveInt
    """Pixels of a frame of the first sequence."""
    photons_per_lux_s: FiniteFloat
    """Photons per frame on perfect pixels, for each lux and second."""
    rendering_photons_per_px: FiniteFloat | None = None
    """Photons per pixel whose shot noise is that of the rendering, least of all sequences."""
    blocks: Mapping[str, NonNegativeInt]
    """Blocks of each group without pooling, over all pairs of frames."""


@dataclass(frozen=True, eq=False)
class Ranking:
    """Measurements over all sequences."""

    facts: RankingFacts
    rows: pd.DataFrame
    """The long table, with `COLUMNS`"""

    def rows_of(self, metric: str, pooling: Pooling, group: str = "all") -> pd.DataFrame:
        """Return the rows of a metric at one pooling, of one group."""
        rows = self.rows
        pooled = (rows["pixels_pooled"] == pooling.pixels) & (rows["frames_pooled"] == pooling[1])
        return rows[pooled & (rows["metric"] == metric) & (rows["group"] == group)]

    def best_of(self, pooling: Pooling, flux: float, group: str) -> "pd.Series[Any] | None":
        """Return the row of the least mean error; None if the group has no blocks."""
        errors = self.rows_of(MEAN, pooling, group)
        errors = errors[(errors["photons"] == flux) & (errors["method"] != BOUND)]
        return None if errors.empty else errors.iloc[int(errors["value"].argmin())]


def ranking_rows(
    samples: pd.DataFrame, settings: RankingSettings, blocks: Mapping[str, int]
) -> pd.DataFrame:
    """Return the long table from the samples of all sequences."""
    ratios = _ratios(samples[samples["metric"] == MEAN], settings, blocks)
    means = table.means(samples, BOUND)
    rows = pd.concat([means, ratios], ignore_index=True) if len(ratios) else means
    rows["surely_lowest"] = rows["surely_lowest"].eq(True)
    return rows.reindex(columns=COLUMNS)


def _ratios(
    errors: pd.DataFrame, settings: RankingSettings, blocks: Mapping[str, int]
) -> pd.DataFrame:
    """Return the ratio of the worse method to the better one, of each pair in compared groups."""
    compared = {name for groups in opposed(blocks) for name in groups[:2]}
    finest = (errors["pixels_pooled"] == settings.finest.pixels) & (
        errors["frames_pooled"] == settings.finest.frames
    )
    rows = []
    wanted = errors[finest & errors["group"].isin(compared)]
    for (flux, group), same in wanted.groupby(["photons", "group"], sort=False):
        sums = {name: table.sums_of(part) for name, part in same.groupby("method", sort=False)}
        for better, worse in permutations(settings.methods, 2):
            if (found := table.ratio(sums[worse], sums[better])) is None:
                continue
            quotient, p = found
            if quotient.value > 1 or (quotient.value == 1 and better < worse):
                rows.append((RATIO, worse, flux, group, *settings.finest, *quotient, better, p))
    return pd.DataFrame(rows, columns=[*table.CASE, "value", "low", "high", "against", "p"])


class RankChange(NamedTuple):
    """Two methods that change places, with the rows of their ratio in both groups."""

    groups: Opposed
    first: Any
    second: Any
    p: float


def changes(ranking: Ranking) -> list[RankChange]:
    """Return the significant changes of order, the smallest p-value first."""
    ratios = ranking.rows[ranking.rows["metric"] == RATIO]
    order = {
        (row.photons, row.group, frozenset((row.method, row.against))): row
        for row in table.records(ratios)
    }
    cases = []
    settings = ranking.facts.settings
    for groups, flux in product(opposed(ranking.facts.blocks), settings.fluxes):
        for pair in combinations(settings.methods, 2):
            first, second = (order.get((flux, group, frozenset(pair))) for group in groups[:2])
            if first and second:
                p = max(first.p, second.p) if first.method != second.method else 1.0
                cases.append(RankChange(groups, first, second, p))
    shares = false_discovery_control([change.p for change in cases])
    kept = (change for change, share in zip(cases, shares, strict=True) if share <= _FALSE_SHARE)
    return sorted(kept, key=lambda change: change.p)


def write_tables(folder: Path, ranking: Ranking) -> None:
    """Write ranking.csv, the long table, and ranking.json, the facts."""
    files.write_text(folder / "ranking.csv", ranking.rows.to_csv(index=False, float_format="%.9g"))
    files.write_text(folder / "ranking.json", ranking.facts.model_dump_json(indent=1) + "\n")


def read_ranking(folder: Path) -> Ranking | None:
    """Read a ranking written by `run_ranking`; None if there is none. Raises UserError."""
    path = folder / "ranking.json"
    if not path.exists():
        return None
    with bounded.undamaged(path, "remove it, or rank the methods again"):
        values = bounded.read_json(path)
        check_format("ranking", values, path)
        facts = RankingFacts.model_validate(values)
    path = folder / "ranking.csv"
    with bounded.undamaged(path, "rank the methods again"):
        rows = pd.read_csv(io.StringIO(bounded.read_text(path)))
        return Ranking(facts, rows[COLUMNS])
