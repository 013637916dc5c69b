"""Errors of a ranking on one axis for all lights, exposures and speeds, and how well they fit it.

In an exposure a pixel gets n photons, and the image moves by φ of its texture scales
(`sequence_errors.texture_scales`). The motion period is the time in which it moves by one: a pixel
gets n/φ photons in it. Errors are relative to the motion. Curves are those of blocks of one speed
at one exposure, over light; pooled frames are longer exposures.

Axes are n·φ^k: k = 0 is the photons of a pixel, k = −1 those per motion period. By the Poisson
bound the relative error is proportional to (n·φ²)^(−1/2), so k = 2 joins curves of methods that use
all information of two frames, whatever their texture; see `translation_bound`. The common curve is
a cubic of logarithms by least squares, of lower degree for fewer lights. The misfit is the RMS
scatter about it, in decades of the error, with its interval over the curves (`table`).
"""

from collections.abc import Mapping
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from megalopta.benchmark.block_truths import RANGES
from megalopta.benchmark.ranking import Ranking, RankingRow
from megalopta.benchmark.ranking_settings import Pooling
from megalopta.benchmark.sequence_errors import ERROR, STILL, TEXTURE
from megalopta.benchmark.table import Case, Interval, root_mean_square
from megalopta.core.arrays import Floats

AXES: Mapping[str, int] = MappingProxyType(
    {
        "photons per pixel": 0,
        "photons per pixel and motion period": -1,
        "photons per pixel · (motion per exposure)²": 2,
    }
)
"""Powers of the motion per exposure, in texture scales, by name of the axis"""

_DEGREE = 3


class Curve(NamedTuple):
    """Relative errors of a method at one speed and exposure, over light."""

    speed: str
    frames: int
    """Frames of an exposure"""
    motion: float
    """Motion per exposure, in texture scales"""
    photons: Floats
    """Per pixel and exposure, (fluxes,)"""
    errors: Floats
    """Mean errors over the mean motion, (fluxes,)"""

    def along(self, power: int) -> Floats:
        """Return the places of the errors on an axis, (fluxes,)."""
        return self.photons * self.motion**power


def curves(ranking: Ranking, method: str) -> list[Curve]:
    """Return the curves of a method, or of the bound; none if a table has no texture scales."""
    settings, found = ranking.settings, []
    fluxes = np.array(sorted(settings.fluxes))
    for speed, frames in product(RANGES, settings.frames_pooled):
        group, pooling = f"speed {speed}", Pooling(settings.finest.pixels, frames)
        rows = [ranking.error_of(pooling, flux, group, method) for flux in fluxes]
        motion = motion_per_exposure(ranking, group, pooling)
        still = ranking.error_of(pooling, fluxes[0], group, STILL)
        if motion and still and ranking.frame_px and any(rows):
            errors = np.array([row.value if row else np.nan for row in rows]) / still.value
            photons = fluxes * frames / ranking.frame_px
            found.append(Curve(speed, frames, motion, photons, errors))
    return found


def motion_per_exposure(ranking: Ranking, group: str, pooling: Pooling) -> float | None:
    """Return the mean motion of a group's blocks in an exposure, in texture scales."""
    flux = ranking.settings.fluxes[0]
    still = ranking.error_of(pooling, flux, group, STILL)
    texture = ranking.row_of(Case(TEXTURE, "light", flux, group, *pooling))
    if still is None or texture is None or not texture.value:
        return None
    return still.value * pooling.frames / texture.value


def photons_per_period(ranking: Ranking, row: RankingRow) -> float | None:
    """Return the photons per pixel and motion period of an error's row; None of other rows."""
    pooling = Pooling(row.pixels_pooled, row.frames_pooled)
    if row.metric != ERROR or not ranking.frame_px:
        return None
    motion = motion_per_exposure(ranking, row.group, pooling)
    return row.photons_per_frame * row.frames_pooled / ranking.frame_px / motion if motion else None


def misfits(of_method: list[Curve]) -> dict[str, Interval]:
    """Return the scatter about the common curve on each axis, decades of the error."""
    return {name: root_mean_square(_residuals(of_method, power)) for name, power in AXES.items()}


def common_curve(of_method: list[Curve], power: int) -> Polynomial:
    """Return the cubic of log₁₀ error over log₁₀ of an axis that fits all curves best."""
    places = np.log10(np.concatenate([each.along(power) for each in of_method]))
    errors = np.concatenate([each.errors for each in of_method])
    there = errors > 0
    degree = min(_DEGREE, len(of_method[0].photons) - 1)
    return Polynomial.fit(places[there], np.log10(errors[there]), degree)


def _residuals(of_method: list[Curve], power: int) -> Floats:
    """Return log₁₀ of errors over the common curve, (curves, fluxes); NaN without any."""
    common = common_curve(of_method, power)
    errors = np.array([np.where(each.errors > 0, each.errors, np.nan) for each in of_method])
    places = np.array([each.along(power) for each in of_method])
    return np.asarray(np.log10(errors) - common(np.log10(places)))
