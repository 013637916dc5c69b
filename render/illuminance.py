"""The illuminance that a scene really gets, measured with the scene's own light and shadows.

A light meter is a small horizontal plate: Mitsuba's irradiance meter gathers light paths from it,
weighted with V(λ). These paths meet everything but the disc of sun or moon, whose part comes from
visibility rays toward points of the disc. The light has as many bounces as in the frames, so that
the meter and the frames miss the same light: at a surface, frames have spent one segment of their
longest path on the way from the camera.

In haze, light is measured as it arrives through it, and what is above everything is above the haze:
there the meter reads the illuminance that was asked for.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render.loading import DISC_POINTS, Air
from megalopta.render.mitsuba_loader import mi
from megalopta.render.path_tracing import PathIntegrator
from megalopta.render.truth import rays
from megalopta.scenes.spectra import MAXIMUM_EFFICACY_LM_W, luminous, luminous_efficiency
from megalopta.scenes.world import Lighting

Float64 = NDArray[np.float64]

_PLATE_M = 0.01
# Above what lies below the camera: clear of it, below the blades of grass.
_CLEARANCE_M = 0.02
# The meter's film has one pixel for each light path: sums of several in one pixel would depend on
# the order in which threads come to it. An even sky needs fewer.
_FILM_PX, _UNEVEN_FILM_PX = 64, 320
_V_NM = np.arange(380.0, 771.0, 10.0)


@dataclass(frozen=True)
class Illuminance:
    """Lux on a horizontal plane."""

    position_m: tuple[float, float, float]
    lux: float
    standard_error_lux: float
    """Of the light paths."""


@dataclass(frozen=True)
class LightSurvey:
    """What a scene gets, in the open and below a camera's path."""

    unshaded: Illuminance
    """Above everything, haze too."""
    ground: tuple[Illuminance, ...]
    """Just above what lies below the camera; empty where nothing does."""


class LightMeter:
    """Measures in a scene that is loaded in the active variant, a spectral one.

    `max_depth` is that of the frames: 2 or more to light anything. `air` is the scene's haze.
    """

    def __init__(
        self, scene: Any, lighting: Lighting, max_depth: int, air: Air | None = None
    ) -> None:
        self._scene, self._lighting, self._max_depth, self._air = scene, lighting, max_depth, air
        self._sun = lighting.sun if max_depth > 1 or air else None
        self._film_px = _UNEVEN_FILM_PX if lighting.patterns or air else _FILM_PX
        self._integrator = PathIntegrator(max_depth - 1, air)

    def survey(self, positions: Float64) -> LightSurvey:
        """Measure above and below camera positions (N, 3), m."""
        below = [point for each in positions if (point := self._below(each)) is not None]
        above_haze = LightMeter(self._scene, self._lighting, self._max_depth)
        return LightSurvey(
            above_haze.measure(self._above_all(positions.mean(axis=0)), seed=0),
            tuple(self.measure(point, seed=1 + index) for index, point in enumerate(below)),
        )

    def measure(self, position: Float64, seed: int) -> Illuminance:
        """Illuminance of a horizontal plane at a position (3,), m."""
        # Must live as long as its sensor, which does not hold it.
        plate = meter_plates(position[None], self._film_px)
        paths = self._integrator.render(self._scene, plate.sensor(), seed=seed, spp=1)
        lux = paths.astype(np.float64)
        return Illuminance(
            tuple(position.tolist()),
            float(lux.mean()) + self._from_disc(position),
            float(lux.std() / math.sqrt(lux.size)),
        )

    def _below(self, position: Float64) -> Float64 | None:
        hits = rays.nearest_hits(self._scene, position, np.array([[0.0, 0.0, -1.0]]))
        distance = float(hits.distance[0])
        drop = np.array([0, 0, max(distance - _CLEARANCE_M, 0)])
        return position - drop if np.isfinite(distance) else None

    def _above_all(self, position: Float64) -> Float64:
        box = self._scene.bbox()
        top = float(box.max.z) if box.valid() else position[2]
        return np.array([position[0], position[1], max(position[2], top) + 1])

    def _from_disc(self, position: Float64) -> float:
        if self._sun is None:
            return 0.0
        toward = self._sun.points(DISC_POINTS)
        hidden = rays.is_hidden(self._scene, position, toward, np.full(DISC_POINTS, np.inf))
        unmet = self._air.transmittance(position, toward) if self._air else np.ones(DISC_POINTS)
        cosine = np.where(hidden, 0, unmet * np.maximum(toward[:, 2], 0)).mean()
        return float(luminous(self._sun.irradiance) * cosine)


def meter_plates(points: Float64, film_px: int) -> Any:
    """Small horizontal plates at points (n, 3), m, as one shape with an irradiance meter (lux).

    Its film has `film_px`² pixels of one light path each.
    """
    weights = MAXIMUM_EFFICACY_LM_W * luminous_efficiency(_V_NM)
    film = {
        "type": "specfilm",
        "width": film_px,
        "height": film_px,
        "component_format": "float32",
        "rfilter": {"type": "box"},
        "lux": {
            "type": "spectrum",
            "value": list(zip(_V_NM.tolist(), weights.tolist(), strict=True)),
        },
    }
    properties = mi.Properties()
    properties["meter"] = mi.load_dict(
        {
            "type": "irradiancemeter",
            "film": film,
            "sampler": {"type": "independent", "sample_count": 1},
        }
    )
    corners = _PLATE_M * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    plates = mi.Mesh("plates", 4 * len(points), 2 * len(points), props=properties)
    buffers = mi.traverse(plates)
    buffers["vertex_positions"] = (points[:, None] + corners).astype(np.float32).ravel()
    first = 4 * np.arange(len(points))[:, None, None]
    buffers["faces"] = (first + np.array([[0, 1, 2], [0, 2, 3]])).astype(np.uint32).ravel()
    buffers.update()
    return plates
