"""Light meter: the illuminance of a scene, in the open and below a camera's path.

Paths start as the cosine to the vertical, at wavelengths sampled in proportion to V(λ), with the
depth of frames. The disc of sun or moon is found by visibility rays toward points of it.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.render.loading.scene import DISC_POINTS, Air
from megalopta.render.path_tracing import PathIntegrator
from megalopta.render.truth.rays import SceneRays
from megalopta.scenes.scene import Lighting
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
        self._rays = SceneRays(scene)
        self._sun = lighting.sun if max_depth > 1 or air else None
        self._paths = _UNEVEN_PATHS if lighting.patterns or air else _PATHS
        self._integrator = PathIntegrator(max_depth - 1, air)

    def survey(self, positions: Floats) -> LightSurvey:
        """Measure above and below camera positions (N, 3), m."""
        below = []
        for position in positions:
            hits = self._rays.nearest(position, np.array([[0.0, 0.0, -1.0]]))
            distance = float(hits.distance[0])
            if np.isfinite(distance):
                below.append(position - [0, 0, max(distance - _CLEARANCE_M, 0)])
        above_haze = LightMeter(self._scene, self._lighting, self._max_depth)
        x, y, z = positions.mean(axis=0)
        box = self._scene.bbox()
        top = float(box.max.z) if box.valid() else z
        return LightSurvey(
            above_haze.measure(np.array([x, y, max(z, top) + 1]), seed=0),
            tuple(self.measure(point, seed=1 + index) for index, point in enumerate(below)),
        )

    def measure(self, position: Floats, seed: int) -> Illuminance:
        """Illuminance of a horizontal plane at a position (3,), m."""
        rng, paths = np.random.default_rng(seed), self._paths
        radius, turn = np.sqrt(rng.random(paths)), 2 * np.pi * rng.random(paths)
        level = radius * np.cos(turn), radius * np.sin(turn)
        upward = np.stack([*level, np.sqrt(np.maximum(1 - radius**2, 0))])
        share = luminous_efficiency(_V_NM + 0.5)
        cumulated = np.concatenate([[0], np.cumsum(share / share.sum())])
        even = (rng.permutation(paths) + rng.random(paths)) / paths
        place = (even + np.arange(4)[:, None] / 4) % 1
        wavelengths = np.interp(place, cumulated, [*_V_NM, _V_NM[-1] + 1])
        step = np.searchsorted(cumulated, place, side="right").clip(1, len(share)) - 1
        weights = luminous_efficiency(wavelengths) * share.sum() / share[step]
        origins = np.broadcast_to(position[:, None], (3, paths))
        light = self._integrator.along(self._scene, origins, upward, wavelengths, seed)
        lux = MAXIMUM_EFFICACY_LM_W * np.pi * (weights * light).mean(axis=0)
        disc_lux = 0.0
        if self._sun is not None:
            toward = self._sun.points(DISC_POINTS)
            hidden = self._rays.is_hidden(position, toward, np.full(DISC_POINTS, np.inf))
            unmet = self._air.transmittance(position, toward) if self._air else np.ones(DISC_POINTS)
            cosine = np.where(hidden, 0, unmet * np.maximum(toward[:, 2], 0)).mean()
            disc_lux = float(luminous(self._sun.irradiance) * cosine)
        return Illuminance(
            tuple(position.tolist()),
            float(lux.mean()) + disc_lux,
            float(lux.std() / math.sqrt(lux.size)),
        )
