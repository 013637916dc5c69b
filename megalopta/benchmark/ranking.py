"""A ranking: its settings, and the long table of methods on rendered sequences, with its files."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import pandas as pd
from pydantic import Field, FiniteFloat, NonNegativeInt, PositiveInt, model_validator

from megalopta.benchmark import table
from megalopta.benchmark.curves import BOUND
from megalopta.benchmark.methods import STRONGEST
from megalopta.config.model import LightLevel, LightLevels
from megalopta.config.scene import ONCE
from megalopta.core.format_numbers import FORMATS
from megalopta.core.quantities import short
from megalopta.core.record import Record
from megalopta.scenes.levels import illuminance_of
from megalopta.stages.noise_warning import LIMIT

FEWEST_SEQUENCES = 5
"""Least number of sequences for sequences to be the units"""
SEGMENTS = 10
"""Parts of successive pairs of frames per sequence, the units if sequences are fewer"""
RANGES = ("low", "medium", "high")
SPEEDS_PX = (1.0, 3.0)
PARALLAX_PX = (0.3, 1.0)
"""Limits between low, medium and high"""


class RankingSettings(Record, frozen=True):
    """Methods and photons."""

    methods: Annotated[tuple[str, ...], ONCE, Field(min_length=1)] = tuple(
        name for name in STRONGEST if name not in ("DualTVL1 tuned", "zero")
    )
    """Methods that give velocities: names, baselines such as `DIS tuned` and `DIS √`,
    `module:function`, `module:function counts`, or ONNX files, by commas or blanks."""
    against: str = ""
    """Method that others are compared with; default: the best at each light."""
    fluxes: Annotated[tuple[Annotated[float, Field(gt=0)], ...], ONCE] = (
        *(1e3, 1e4, 1e5, 1e6, 1e7, 1e8),
    )
    """Photons per frame, summed over all pixels."""
    photons: Annotated[tuple[Annotated[float, Field(gt=0)], ...], ONCE] = ()
    """Photons per pixel and frame, in place of the default fluxes."""
    light_levels: LightLevels = ()
    """Further light levels, by name or in lux; their photons per frame are added to fluxes."""
    exposure_s: Annotated[float, Field(gt=0, le=1000)] = 0.01
    """Exposure of a frame at these levels (s)."""
    repeats: Annotated[int, Field(ge=1)] = 2
    """Independent photon draws per sequence."""
    seed: int = 0
    """Seed of the photons."""

    @model_validator(mode="after")
    def _has_light(self) -> "RankingSettings":
        if not self.fluxes and not self.light_levels:
            raise ValueError("give fluxes, or light_levels")
        return self


def photons_at(per_lux_s: float, level: LightLevel, exposure_s: float) -> float:
    """Photons of a mean frame at a level, in the rendered color; four digits."""
    return float(f"{per_lux_s * illuminance_of(level) * exposure_s:.4g}")


class RankingFacts(Record, frozen=True):
    """What was measured: `ranking.json`."""

    format: NonNegativeInt = FORMATS["ranking"].written
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
    """Photons per pixel whose shot noise has the variance of the rendering's noise, least of all
    sequences."""
    blocks: Mapping[str, NonNegativeInt]
    """Blocks of each group, over all pairs of frames."""

    def rendering_noise(self, flux: float) -> float:
        """Return the variance of the rendering's noise over that of shot noise."""
        equal = self.rendering_photons_per_px
        return flux / self.frame_px / equal if equal else 0.0

    def light(self, flux: float) -> str:
        """Return photons per frame as a number of the unit in which they were given."""
        return short(flux / self.unit[2])

    @property
    def unit(self) -> tuple[str, str, int]:
        """Unit in which lights were given, its option, and photons per frame that it is."""
        if self.settings.photons:
            return "photons per pixel", "--photons", self.frame_px
        return "photons per frame", "--fluxes", 1

    @property
    def noisy_fluxes(self) -> list[float]:
        """Fluxes at which rendering noise adds more than a tenth to the variance of shot noise."""
        return [flux for flux in self.settings.fluxes if self.rendering_noise(flux) > LIMIT]


@dataclass(frozen=True, eq=False)
class Ranking:
    """Measurements over all sequences."""

    facts: RankingFacts
    rows: pd.DataFrame
    """The long table (`table.means`)"""
    samples: pd.DataFrame | None = None
    """What the means are of (`table.samples`)"""

    def rows_of(self, metric: str, group: str = "all") -> pd.DataFrame:
        """Return the rows of a metric, of one group."""
        return self.rows[(self.rows["metric"] == metric) & (self.rows["group"] == group)]

    def best(self) -> pd.DataFrame:
        """Return the row of the least mean error at each light."""
        errors = self.rows_of(table.MEAN)
        errors = errors[errors["method"] != BOUND]
        return errors.loc[errors.groupby("photons")["value"].idxmin()]
