"""Ground truth of whole pixels, from rays spread evenly over them.

The truth of a frame is that of the pixel centers, but light comes from whole pixels. K = k² rays
are in the middle of the cells of multi-jittered sampling (Chiu, Shirley and Wang, Graphics Gems IV,
1994): one in each of k × k squares, of K columns and of K rows. They are the same for all pixels
and frames. Four more in the corners find outlines that just cross a pixel (`coverage`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.render import mi
from megalopta.render.truth.coverage import Probes, ray_weights
from megalopta.render.truth.geometry import Geometry, View, correspondence
from megalopta.scenes.cameras.base import Camera

Float32 = NDArray[np.float32]

# Their results take memory, a few hundred bytes per ray. A graphics card needs many at once.
_RAYS_AT_ONCE = {"cuda": 2**21, "llvm": 2**18, "scalar": 2**16}


@dataclass(frozen=True)
class FlowSpread:
    """Flow over each pixel (H, W) toward another frame."""

    mean: Float32
    """(H, W, 2): mean displacement (x, y) in px; NaN if no part of the pixel has one."""
    spread: Float32
    """(H, W): root mean square deviation from the mean, px; NaN as the mean."""
    hidden: Float32
    """(H, W): share of the pixel occluded from the other frame's camera."""

    @property
    def is_partly_hidden(self) -> Mask:
        """Pixels (H, W) that are partly occluded."""
        return np.asarray((self.hidden > 0) & (self.hidden < 1))


@dataclass(frozen=True)
class Footprint:
    """Truth of whole pixels (H, W)."""

    purity: Float32
    """(H, W): share of the pixel filled by the object at its center."""
    sky: Float32
    """(H, W): share of the pixel that is sky."""
    forward: FlowSpread
    backward: FlowSpread
    """Flow toward the next frame and the previous one."""

    @property
    def is_mixed(self) -> Mask:
        """Pixels (H, W) that contain more than the object at their center."""
        return np.asarray(self.purity < 1)

    @property
    def is_sky(self) -> Mask:
        """Pixels (H, W) that contain only sky."""
        return np.asarray(self.sky == 1)


class Footprints:
    """Truth of whole pixels of a scene, with some rays each, rounded up to a square."""

    def __init__(self, geometry: Geometry, camera: Camera, rays: int) -> None:
        self._geometry, self._camera = geometry, camera
        grid = math.isqrt(rays - 1) + 1
        i, j = (index.ravel() for index in np.meshgrid(np.arange(grid), np.arange(grid)))
        inside = np.stack([i + (j + 0.5) / grid, j + (i + 0.5) / grid], axis=-1) / grid
        corners = [(0, 0), (1, 0), (0, 1), (1, 1)]
        offsets = np.concatenate([inside, np.array(corners, dtype=float)])
        alike = np.concatenate([np.full(len(inside), 1 / len(inside)), np.zeros(4)])
        self._probes = Probes(offsets, alike)

    def footprint(
        self,
        view: View,
        following: View | None,
        previous: View | None,
        object_id: NDArray[np.uint32],
    ) -> Footprint:
        """Footprint of a frame whose pixel centers see objects (H, W)."""
        family = str(mi.variant()).partition("_")[0]
        height, per_row = self._camera.height, self._camera.width * len(self._probes.offsets)
        step = max(1, _RAYS_AT_ONCE[family] // per_row)
        strips = [slice(first, min(first + step, height)) for first in range(0, height, step)]
        parts = [self._of_rows(view, following, previous, object_id, rows) for rows in strips]
        joined: Footprint = _joined(parts)
        return joined

    def _of_rows(
        self,
        view: View,
        following: View | None,
        previous: View | None,
        object_id: NDArray[np.uint32],
        rows: slice,
    ) -> Footprint:
        camera, centers = self._camera, object_id[rows]
        places = (camera.pixel_centers()[rows] - 0.5).reshape(-1, 2)
        image = (places[:, None] + self._probes.offsets).reshape(-1, 2)
        pixels = slice(rows.start * camera.width, rows.stop * camera.width)
        eyes = view.pixels(camera).of(pixels)
        of_rays = eyes.of(slice(None), len(self._probes.offsets))
        directions = of_rays.to_world(camera.toward(image))
        surface = self._geometry.glimpsed(of_rays.origin, directions, of_rays.time_s)
        weights = ray_weights(self._geometry, camera, eyes, surface, places, self._probes)
        things = self._geometry.object_id[surface.triangle].reshape(weights.shape)

        # Rays without a share need no flow, which is the costlier part.
        used = weights > 0
        pixel = np.nonzero(used)[0]
        seen, places_used = surface.of(used.ravel()), image[used.ravel()]

        def share(where: Mask) -> Float32:
            sums = (weights * where).sum(axis=1)
            return np.asarray(sums.reshape(centers.shape), np.float32)

        def flow(other: View | None) -> FlowSpread:
            if other is None:
                undefined = np.full((*centers.shape, 2), np.nan, np.float32)
                return FlowSpread(undefined, undefined[..., 0], np.zeros(centers.shape, np.float32))
            way = correspondence(self._geometry, camera, seen, places_used, other)
            spread = _spread(way.displacement, way.is_hidden, weights[used], pixel, centers.size)
            shaped = spread.reshape(*centers.shape, 4).astype(np.float32)
            return FlowSpread(shaped[..., :2], shaped[..., 2], shaped[..., 3])

        return Footprint(
            share(things == centers.reshape(-1, 1)),
            share(things == 0),
            flow(following),
            flow(previous),
        )


def _spread(flow: Floats, hidden: Mask, weights: Floats, pixel: Ints, count: int) -> Floats:
    """Mean flow (x, y), root mean square deviation from it, and occluded share (count, 4).

    For rays (n,) of pixels, numbered by `pixel`, some of which have no flow (n, 2).
    """

    def total(values: Floats) -> Floats:
        return np.asarray(np.bincount(pixel, values, count), np.float64)

    known = np.asarray(np.isfinite(flow).all(axis=1))
    shares = weights * known
    x, y = np.where(known[:, None], flow, 0.0).T
    with np.errstate(invalid="ignore"):
        shown = total(shares)
        mean_x, mean_y = total(shares * x) / shown, total(shares * y) / shown
        away = np.where(known, (x - mean_x[pixel]) ** 2 + (y - mean_y[pixel]) ** 2, 0.0)
        spread = np.sqrt(total(shares * away) / shown)
    return np.stack([mean_x, mean_y, spread, total(weights * hidden)], axis=-1)


def _joined(parts: Sequence[Any]) -> Any:
    """Return strips of rows joined, for arrays or records of them."""
    kind = type(parts[0])
    if kind is np.ndarray:
        return np.concatenate(parts)
    columns = ([getattr(part, field.name) for part in parts] for field in fields(kind))
    return kind(*map(_joined, columns))
