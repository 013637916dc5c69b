"""Photons per frame at light levels, and the best method at each."""

from collections.abc import Mapping, Sequence

import numpy as np

from megalopta.benchmark.ranking_errors import STILL
from megalopta.benchmark.ranking_record import Ranking
from megalopta.benchmark.ranking_settings import RankingSettings
from megalopta.benchmark.velocities import photons_per_lux_s
from megalopta.config.model import LightLevel, level_text
from megalopta.dataset.store import Dataset
from megalopta.plotting.sections import Section
from megalopta.plotting.text import UNDEFINED, number
from megalopta.scenes.lighting.levels import LEVELS, illuminance_of

EXPOSURES_S = (0.001, 0.01, 0.1)
_NEAR = 3.0
"""Measurements at up to so many times more or fewer photons stand for a level."""


def lit(settings: RankingSettings, datasets: Sequence[Dataset]) -> RankingSettings:
    """Add the photons per frame of the light levels to those that are measured."""
    if not settings.light_levels:
        return settings
    per_lux = float(np.mean([photons_per_lux_s(each) for each in datasets]))
    found = [photons_at(per_lux, each, settings.exposure_s) for each in settings.light_levels]
    fluxes = sorted({*settings.fluxes, *found})
    return settings.model_copy(update={"fluxes": tuple(fluxes)})


def photons_at(per_lux_s: float, level: LightLevel, exposure_s: float) -> float:
    """Photons of a mean frame at a level, of the color that was rendered; four digits."""
    return float(f"{per_lux_s * illuminance_of(level) * exposure_s:.4g}")


def levels_section(ranking: Ranking) -> Section:
    """Return the best method at every named level, and at those that were asked for."""
    settings = ranking.settings
    levels: Mapping[str, LightLevel] = {
        level_text(each): each for each in (*LEVELS, *settings.light_levels)
    }
    exposures = sorted({*EXPOSURES_S, settings.exposure_s})
    rows = tuple(
        (name, f"{illuminance_of(level):.3g}", *(_cell(ranking, level, t) for t in exposures))
        for name, level in sorted(levels.items(), key=lambda each: -illuminance_of(each[1]))
    )
    return Section(
        "Light levels",
        "The best method without pooling on perfect pixels, and the photons per frame, of frames "
        "exposed for so long. Light keeps the color that was rendered. What was measured at up to "
        f"{_NEAR:g} times more or fewer photons stands for a level.",
        ("level", "lux", *(f"{exposure:g} s" for exposure in exposures)),
        rows,
    )


def _cell(ranking: Ranking, level: LightLevel, exposure_s: float) -> str:
    photons = photons_at(ranking.photons_per_lux_s, level, exposure_s)
    nearest = min(ranking.settings.fluxes, key=lambda each: abs(np.log(each / photons)))
    best = ranking.best_of(ranking.settings.finest, nearest, "all")
    if best is None or abs(np.log(nearest / photons)) > np.log(_NEAR):
        return f"{UNDEFINED} ({number(photons)})"
    method = "none" if best.method == STILL else best.method
    return f"{method}{'' if best.is_sure else ', not sure'} ({number(photons)})"
