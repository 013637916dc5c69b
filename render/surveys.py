"""Surveys of a scene: its illuminance and its canopy.

A light meter traces light paths from a point, in directions distributed as the cosine to the
vertical, at wavelengths sampled in proportion to V(λ). These paths include everything but the disc
of sun or moon, whose part comes from visibility rays toward points of the disc. The path depth is
that of the frames: at a surface, these have spent one segment of their longest path on the way from
the camera. In haze, light is measured as it arrives through it; above everything is above the haze,
where the meter reads the requested illuminance.

Gap fraction is the share of rays at a zenith angle that hit nothing. Rays start one meter above the
ground, where hemispherical photographs are taken, and ignore materials. For a canopy of randomly
placed leaves it is exp(−G·L/cos θ), with the leaf-area index L and the mean projection G of a unit
of leaf, one half for random orientations (Beer–Lambert; Ross 1981, The radiation regime and
architecture of plant stands).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from megalopta.core.arrays import Floats
from megalopta.render.loading.air import Air
from megalopta.render.loading.scene import DISC_POINTS
from megalopta.render.path_tracing import PathIntegrator
from megalopta.render.truth import rays
from megalopta.scenes.forest.canopy import floor_points, plant_area
from megalopta.scenes.scene import Lighting, Scene
from megalopta.scenes.spectra.spectrum import MAXIMUM_EFFICACY_LM_W, luminous, luminous_efficiency

# Height above the surface below the camera: clear of it, but below the blades of grass.
_CLEARANCE_M = 0.02
# Number per point. A uniform sky needs fewer.
_PATHS, _UNEVEN_PATHS = 64**2, 320**2
_V_NM = np.arange(380.0, 770.0)


@dataclass(frozen=True)
class Illuminance:
    """Illuminance of a horizontal plane, lux."""

    position_m: tuple[float, float, float]
    lux: float
    standard_error_lux: float
    """Standard error due to the light paths."""


@dataclass(frozen=True)
class LightSurvey:
    """Illuminance of a scene, in the open and below a camera's path."""

    unshaded: Illuminance
    """Above everything, including haze."""
    ground: tuple[Illuminance, ...]
    """Just above the surface below the camera; empty if there is none."""


class LightMeter:
    """Light meter in a scene that is loaded in the active variant, a spectral one.

    `max_depth` is that of the frames, at least 2 for any light. `air` is the scene's haze.
    """

    def __init__(
        self, scene: Any, lighting: Lighting, max_depth: int, air: Air | None = None
    ) -> None:
        self._scene, self._lighting, self._max_depth, self._air = scene, lighting, max_depth, air
        self._sun = lighting.sun if max_depth > 1 or air else None
        self._paths = _UNEVEN_PATHS if lighting.patterns or air else _PATHS
        self._integrator = PathIntegrator(max_depth - 1, air)

    def survey(self, positions: Floats) -> LightSurvey:
        """Measure above and below camera positions (N, 3), m."""
        below = [point for each in positions if (point := self._below(each)) is not None]
        above_haze = LightMeter(self._scene, self._lighting, self._max_depth)
        return LightSurvey(
            above_haze.measure(self._above_all(positions.mean(axis=0)), seed=0),
            tuple(self.measure(point, seed=1 + index) for index, point in enumerate(below)),
        )

    def measure(self, position: Floats, seed: int) -> Illuminance:
        """Illuminance of a horizontal plane at a position (3,), m."""
        lux = illuminances(self._scene, position[None], self._paths, self._integrator, seed)
        return Illuminance(
            tuple(position.tolist()),
            float(lux.mean()) + self._from_disc(position),
            float(lux.std() / math.sqrt(lux.size)),
        )

    def _below(self, position: Floats) -> Floats | None:
        hits = rays.nearest_hits(self._scene, position, np.array([[0.0, 0.0, -1.0]]))
        distance = float(hits.distance[0])
        drop = np.array([0, 0, max(distance - _CLEARANCE_M, 0)])
        return position - drop if np.isfinite(distance) else None

    def _above_all(self, position: Floats) -> Floats:
        box = self._scene.bbox()
        top = float(box.max.z) if box.valid() else position[2]
        return np.array([position[0], position[1], max(position[2], top) + 1])

    def _from_disc(self, position: Floats) -> float:
        if self._sun is None:
            return 0.0
        toward = self._sun.points(DISC_POINTS)
        hidden = rays.is_hidden(self._scene, position, toward, np.full(DISC_POINTS, np.inf))
        unmet = self._air.transmittance(position, toward) if self._air else np.ones(DISC_POINTS)
        cosine = np.where(hidden, 0, unmet * np.maximum(toward[:, 2], 0)).mean()
        return float(luminous(self._sun.irradiance) * cosine)


def illuminances(
    scene: Any, points: Floats, paths: int, integrator: PathIntegrator, seed: int
) -> Floats:
    """Illuminance (lux) of horizontal planes at points (n, 3), m, by single light paths (paths,).

    Each starts at one of the points, at four wavelengths sampled by the eye's sensitivity.
    """
    rng = np.random.default_rng(seed)
    radius, turn = np.sqrt(rng.random(paths)), 2 * np.pi * rng.random(paths)
    level = radius * np.cos(turn), radius * np.sin(turn)
    upward = np.stack([*level, np.sqrt(np.maximum(1 - radius**2, 0))])
    origins = points[rng.integers(len(points), size=paths)].T
    share = luminous_efficiency(_V_NM + 0.5)
    cumulated = np.concatenate([[0], np.cumsum(share / share.sum())])
    even = (rng.permutation(paths) + rng.random(paths)) / paths
    place = (even + np.arange(4)[:, None] / 4) % 1
    wavelengths = np.interp(place, cumulated, [*_V_NM, _V_NM[-1] + 1])
    step = np.searchsorted(cumulated, place, side="right").clip(1, len(share)) - 1
    weights = luminous_efficiency(wavelengths) * share.sum() / share[step]
    light = integrator.along(scene, origins, upward, wavelengths, seed)
    return np.asarray(MAXIMUM_EFFICACY_LM_W * np.pi * (weights * light).mean(axis=0))


ZENITHS_DEG = (0.0, 30.0, 57.0, 75.0)
"""Zenith angles; at 57 degrees leaves of any inclination project equally (degrees)."""
HEIGHT_M = 1.0
"""Height of the origins of rays above the ground (m)."""
_PLACES, _AZIMUTHS = 512, 64
_FLOOR_PATHS, _MAX_DEPTH = 160**2, 12


@dataclass(frozen=True)
class Share:
    """Mean over places, with its standard error."""

    value: float
    standard_error: float


@dataclass(frozen=True)
class Canopy:
    """Canopy around a camera's path, and the light through it."""

    leaf_area_index: float
    """One-sided leaf area over ground (m²/m²)."""
    wood_share: float
    """Wood, counted with half its surface, over wood and leaves (1)."""
    gaps: dict[float, Share]
    """Gap fraction by zenith angle (degrees)."""
    floor_light: Share | None
    """Illuminance on the floor relative to the open's (1); None unless under a uniform sky."""

    def __str__(self) -> str:
        """Summary in a sentence."""
        gaps = ", ".join(f"{_percent(gap)} at {angle:g}°" for angle, gap in self.gaps.items())
        light = self.floor_light
        floor = f"; {_percent(light)} of the sky's light reaches the floor" if light else ""
        return (
            f"Leaf-area index {self.leaf_area_index:.2f}, wood {100 * self.wood_share:.0f} % of "
            f"the plant area; gaps {gaps}{floor}."
        )


def _percent(share: Share) -> str:
    digits = int(np.clip(1 - np.floor(np.log10(max(100 * share.standard_error, 1e-3))), 0, 3))
    return f"{100 * share.value:.{digits}f} ± {100 * share.standard_error:.{digits}f} %"


def measure_canopy(
    loaded: Any, scene: Scene, path_xy: ArrayLike, ring_m: tuple[float, float], seed: int = 0
) -> Canopy:
    """Measure a forest as built.

    Parameters
    ----------
    loaded
        Mitsuba's scene, at time 0, in the active variant.
    scene
        The forest; its first object is the ground.
    path_xy : (n, 2)
        Positions of the camera (m).
    ring_m
        Smallest and largest distance from the path at which it is measured (m).
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
    points: Floats,
    zenith_deg: float,
    rng: np.random.Generator,
    azimuths: int = _AZIMUTHS,
) -> Share:
    """Share of rays from points (n, 3) at a zenith angle that hit nothing in a loaded scene.

    The standard error is that of the mean over points, which must be independent.
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
    origins, far = points.repeat(azimuths, axis=0), np.full(len(azimuth), np.inf)
    hit = rays.is_hidden(loaded, origins, np.stack(along, axis=-1), far)
    share = 1 - hit.reshape(len(points), azimuths).mean(axis=1)
    return Share(float(share.mean()), float(share.std(ddof=1) / np.sqrt(len(share))))


def _floor_light(loaded: Any, points: Floats) -> Share:
    sky = points.mean(axis=0) + np.array([0.0, 0.0, 1000.0])
    paths = PathIntegrator(_MAX_DEPTH - 1)
    below, above = (
        illuminances(loaded, where, _FLOOR_PATHS, paths, seed=1) for where in (points, sky[None])
    )
    return Share(
        float(below.mean() / above.mean()),
        float(below.std() / np.sqrt(below.size) / above.mean()),
    )
