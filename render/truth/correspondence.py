"""Where another frame sees the points that rays of this one see, and whether it does."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.render.truth.geometry import Geometry
from megalopta.render.truth.surface import Surface
from megalopta.render.truth.views import Eyes, View
from megalopta.scenes.cameras.base import Camera

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Correspondence:
    """Of N rays."""

    displacement: Float64
    """(N, 2): way in px from where a ray starts in the image; NaN where there is none."""
    is_hidden: NDArray[np.bool_]
    """(N,): whether something, or the surface's own other side, is between point and camera."""


def correspondence(
    geometry: Geometry, camera: Camera, surface: Surface, image: Float64, other: View
) -> Correspondence:
    """Follow a surface (N) from image coordinates (N, 2) to another frame."""

    def way(eyes: Eyes) -> Float64:
        return eyes.way(geometry.carried(surface, eyes.time_s), surface.is_sky)

    seen, shown = other.seeing(camera, way, len(image))
    there = way(seen)
    displacement = camera.displacement(seen.to_camera(there), image)
    there = there if shown is seen else way(shown)
    distance = np.where(surface.is_sky, np.inf, 1.0)
    hidden = geometry.is_hidden(shown.origin, there, distance, shown.time_s)
    hidden |= ~geometry.faces(surface, there, shown.time_s)
    return Correspondence(displacement, hidden)
