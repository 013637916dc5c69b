"""Where another frame sees the points that rays of this one see, and whether it does."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.render.truth.geometry import Geometry, Surface
from megalopta.render.truth.views import View
from megalopta.scenes.cameras import Camera

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
    points = geometry.carried(surface, other.time_s)
    eyes = other.seeing(camera, points, surface.is_sky)
    way = np.where(surface.is_sky[:, None], points, points - eyes.origin)
    displacement = camera.displacement(eyes.to_camera(way), image)
    length = np.linalg.norm(way, axis=-1)
    distance = np.where(surface.is_sky, np.inf, length)
    hidden = geometry.is_hidden(eyes.origin, way / length[:, None], distance, other.time_s)
    hidden |= ~geometry.faces(surface, way, other.time_s)
    return Correspondence(displacement, hidden)
