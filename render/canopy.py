"""What of the sky is seen from a forest's floor, and how much of its light comes down.

Gap fraction is the share of rays at a zenith angle that hit nothing. Rays start one meter above the
ground, where hemispherical photographs are taken, and know of no material: the measure does not
depend on shading. Of a canopy of leaves in random places it is exp(−G·L/cos θ), with the leaf-area
index L and the mean projection G of a unit of leaf, one half where leaves face anywhere
(Beer–Lambert; Ross 1981, The radiation regime and architecture of plant stands).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.render.illuminance import illuminances
from megalopta.render.path_tracing import PathIntegrator
from megalopta.render.truth import rays
from megalopta.scenes.forest.canopy import floor_points, plant_area
from megalopta.scenes.scene import Scene

Float64 = NDArray[np.float64]

ZENITHS_DEG = (0.0, 30.0, 57.0, 75.0)
"""At 57 degrees leaves of any inclination project alike (degrees)."""
HEIGHT_M = 1.0
"""Of the places where rays start, above the ground (m)."""
_PLACES, _AZIMUTHS = 512, 64
_PATHS, _MAX_DEPTH = 160**2, 12


@dataclass(frozen=True)
class Share:
    """A mean over places, with its standard error."""

    value: float
    standard_error: float


@dataclass(frozen=True)
class Canopy:
    """What a forest holds around a camera's path, and what comes through it."""

    leaf_area_index: float
    """One-sided leaf area over ground (m²/m²)."""
    wood_share: float
    """Wood, by half its surface, over wood and leaves (1)."""
    gaps: dict[float, Share]
    """Gap fraction by zenith angle (degrees)."""
    floor_light: Share | None
    """Illuminance on the floor over the open's (1); None but under an even sky."""

    def __str__(self) -> str:
        """All of it in a sentence."""
        gaps = ", ".join(f"{_percent(gap)} at {angle:g}°" for angle, gap in self.gaps.items())
        light = self.floor_light
        floor = f"; {_percent(light)} of the sky's light comes to the floor" if light else ""
        return (
            f"Leaf-area index {self.leaf_area_index:.2f}, wood {self.wood_share:.0%} of the plant "
            f"area; gaps {gaps}{floor}."
        )


def _percent(share: Share) -> str:
    digits = int(np.clip(1 - np.floor(np.log10(max(100 * share.standard_error, 1e-3))), 0, 3))
    return f"{100 * share.value:.{digits}f} ± {100 * share.standard_error:.{digits}f} %"


def measure_canopy(
    loaded: Any, scene: Scene, path_xy: ArrayLike, ring_m: tuple[float, float], seed: int = 0
) -> Canopy:
    """Measure a forest as it is built.

    Parameters
    ----------
    loaded
        The scene as Mitsuba has it, at time 0, in the active variant.
    scene
        The forest; its first object is the ground.
    path_xy : (n, 2)
        Positions of the camera (m).
    ring_m
        Least and largest distance from the path at which it is measured (m).
    """
    area = plant_area(scene, path_xy, ring_m)
    rng = np.random.default_rng(seed)
    points = floor_points(scene, path_xy, ring_m, HEIGHT_M, _PLACES, rng) - scene.origin_m
    gaps = {angle: gap_fraction(loaded, points, angle, rng) for angle in ZENITHS_DEG}
    has_even_sky = scene.lighting is not None and scene.lighting.is_even
    light = _floor_light(loaded, points) if has_even_sky else None
    return Canopy(area.leaf_area_index, area.wood_share, gaps, light)


def gap_fraction(
    loaded: Any,
    points: Float64,
    zenith_deg: float,
    rng: np.random.Generator,
    azimuths: int = _AZIMUTHS,
) -> Share:
    """Share of rays from points (n, 3) at a zenith angle that hit nothing in a loaded scene.

    The standard error is that of the mean over points, which are to be independent.
    """
    turn = rng.random((len(points), azimuths))
    azimuth = 2 * np.pi * (np.arange(azimuths) + turn).ravel() / azimuths
    zenith = np.radians(zenith_deg)
    level = np.sin(zenith)
    along = [
        level * np.cos(azimuth),
        level * np.sin(azimuth),
        np.full(azimuth.shape, np.cos(zenith)),
    ]
    limits = np.full(len(azimuth), float(np.finfo(np.float32).max))
    hit = rays.blocked(loaded, points.repeat(azimuths, axis=0), np.stack(along, axis=-1), limits)
    return _mean_of(1 - np.array(hit, dtype=float).reshape(len(points), azimuths).mean(axis=1))


def _floor_light(loaded: Any, points: Float64) -> Share:
    sky = points.mean(axis=0) + np.array([0.0, 0.0, 1000.0])
    paths = PathIntegrator(_MAX_DEPTH - 1)
    below, above = (
        illuminances(loaded, where, _PATHS, paths, seed=1) for where in (points, sky[None])
    )
    return Share(
        float(below.mean() / above.mean()),
        float(below.std() / np.sqrt(below.size) / above.mean()),
    )


def _mean_of(values: Float64) -> Share:
    return Share(float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values))))
