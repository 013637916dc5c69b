"""Haze in Mitsuba: a homogeneous medium in a box around all surfaces and the camera.

It is a separate scene: ground truth requires nothing between camera and surfaces.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.render import mi
from megalopta.render.loading.materials import spectrum
from megalopta.render.loading.meshes import MergedMesh
from megalopta.render.loading.scene import load_scene, of_shapes
from megalopta.scenes.scene import Haze, Scene
from megalopta.scenes.spectra.spectrum import flat

MARGIN_M = 1.0
"""Margin of the box beyond surfaces and camera."""


@dataclass(frozen=True)
class Air:
    """Haze of a scene, and the scene in it."""

    scene: Any
    """Scene of the surfaces and the box."""
    medium: Any
    """Medium in which sensors in the box start."""
    extinction_per_m: float
    low: Floats
    high: Floats
    """(3,): corners of the box, m."""

    def holds(self, points: Floats) -> bool:
        """True if points (..., 3), m, are all in the box."""
        return bool(((points > self.low) & (points < self.high)).all())

    def transmittance(self, point: Floats, toward: Floats) -> Floats:
        """Share (N,) of light from unit directions (N, 3) that reaches a point (3,) unscattered."""
        with np.errstate(divide="ignore"):
            ends = np.maximum((self.low - point) / toward, (self.high - point) / toward)
        return np.asarray(np.exp(-self.extinction_per_m * ends.min(axis=1)))


def fill(
    scene: Scene, haze: Haze, loaded: Any, meshes: Sequence[MergedMesh], positions: Floats
) -> Air:
    """Fill a loaded scene of meshes with haze, in a box that holds positions (N, 3) too, m.

    Moving shapes are loaded again: if two scenes share one, only the first is updated.
    """
    box = loaded.bbox()
    corners = np.array([box.min, box.max], np.float64)
    points = np.concatenate([corners, positions])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    medium = mi.load_dict(
        {
            "type": "homogeneous",
            "sigma_t": _everywhere(haze.extinction_per_m),
            "albedo": _everywhere(haze.albedo),
            "phase": {"type": "hg", "g": haze.asymmetry},
        }
    )
    place = mi.ScalarTransform4f().translate(((low + high) / 2).tolist())
    walls = {
        "type": "cube",
        "to_world": place.scale(((high - low) / 2).tolist()),
        "bsdf": {"type": "null"},
        "interior": medium,
    }
    shapes = load_scene(scene, meshes).shapes() if scene.is_moving else loaded.shapes()
    filled = of_shapes([*shapes, mi.load_dict(walls)], scene.lighting)
    return Air(filled, medium, haze.extinction_per_m, low, high)


def _everywhere(value: float) -> dict[str, Any]:
    return {"type": "constvolume", "value": spectrum(flat(value))}
