"""Ground truth of whole pixels, from rays spread evenly over them.

K = k² rays are in the middle of the cells of multi-jittered sampling (Chiu, Shirley and Wang,
Graphics Gems IV, 1994), the same for all pixels and frames. Four more are in the corners.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.core.compiling import compiled
from megalopta.render import mi
from megalopta.render.truth.geometry import Eyes, Geometry, Surface, View, correspondence
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


class Footprints:
    """Truth of whole pixels of a scene, with some rays each, rounded up to a square."""

    def __init__(self, geometry: Geometry, camera: Camera, rays: int) -> None:
        self._geometry, self._camera = geometry, camera
        grid = math.isqrt(rays - 1) + 1
        i, j = (index.ravel() for index in np.meshgrid(np.arange(grid), np.arange(grid)))
        inside = np.stack([i + (j + 0.5) / grid, j + (i + 0.5) / grid], axis=-1) / grid
        corners = [(0, 0), (1, 0), (0, 1), (1, 1)]
        self._offsets = np.concatenate([inside, np.array(corners, dtype=float)])
        self._alike = np.concatenate([np.full(len(inside), 1 / len(inside)), np.zeros(4)])

    def footprint(
        self,
        view: View,
        following: View | None,
        previous: View | None,
        object_id: NDArray[np.uint32],
    ) -> Footprint:
        """Footprint of a frame whose pixel centers see objects (H, W)."""
        family = str(mi.variant()).partition("_")[0]
        height, per_row = self._camera.height, self._camera.width * len(self._offsets)
        step = max(1, _RAYS_AT_ONCE[family] // per_row)
        strips = [slice(first, min(first + step, height)) for first in range(0, height, step)]
        parts = [self._of_rows(view, following, previous, object_id, rows) for rows in strips]
        purity, sky, *flows = np.split(np.concatenate(parts), [1, 2, 6], axis=-1)
        spreads = (FlowSpread(flow[..., :2], flow[..., 2], flow[..., 3]) for flow in flows)
        return Footprint(purity[..., 0], sky[..., 0], *spreads)

    def _of_rows(
        self,
        view: View,
        following: View | None,
        previous: View | None,
        object_id: NDArray[np.uint32],
        rows: slice,
    ) -> Float32:
        """Purity, sky, and mean flow (x, y), spread and hidden share of both flows (h, W, 10)."""
        camera, centers = self._camera, object_id[rows]
        places = (camera.pixel_centers()[rows] - 0.5).reshape(-1, 2)
        image = (places[:, None] + self._offsets).reshape(-1, 2)
        pixels = slice(rows.start * camera.width, rows.stop * camera.width)
        eyes = view.pixels(camera).of(pixels)
        of_rays = eyes.of(slice(None), len(self._offsets))
        directions = of_rays.to_world(camera.toward(image))
        surface = self._geometry.glimpsed(of_rays.origin, directions, of_rays.time_s)
        weights = ray_weights(
            self._geometry, camera, eyes, surface, places, self._offsets, self._alike
        )
        things = self._geometry.object_id[surface.triangle].reshape(weights.shape)

        # Rays without a share need no flow, which is the costlier part.
        used = weights > 0
        pixel = np.nonzero(used)[0]
        seen, places_used = surface.of(used.ravel()), image[used.ravel()]
        shares = [
            (weights * (things == thing)).sum(axis=1) for thing in (centers.reshape(-1, 1), 0)
        ]
        columns = [np.stack(shares, axis=-1)]
        for neighbor in (following, previous):
            spread = np.broadcast_to([np.nan, np.nan, np.nan, 0.0], (centers.size, 4))
            if neighbor is not None:
                way = correspondence(self._geometry, camera, seen, places_used, neighbor)
                spread = _spread(*way, weights[used], pixel, centers.size)
            columns.append(spread)
        table = np.concatenate(columns, axis=1).reshape(*centers.shape, 10)
        return np.asarray(table, np.float32)


def _spread(flow: Floats, hidden: Mask, weights: Floats, pixel: Ints, count: int) -> Floats:
    """Mean flow (x, y), RMS deviation from it, and occluded share (count, 4), of rays (n,)."""

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


# In compiled loops numbers are set one by one: an assignment to a row takes seconds to compile.

# The square clipped by three lines.
_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
_MOST_CORNERS = 8


def ray_weights(
    geometry: Geometry,
    camera: Camera,
    eyes: Eyes,
    surface: Surface,
    places: Floats,
    offsets: Floats,
    alike: Floats,
) -> Floats:
    """Share of the pixel (P, K) of each of K rays in P pixels, which sum to 1.

    Shares are equal, unless a pixel contains two objects and the outline of the nearer one is
    known: its triangles are then clipped to the pixel, exactly even for few rays. It is known if
    every ray, except on edges, hits the nearer object exactly where one of these triangles is. Rays
    in the corners find any part that a straight outline cuts off. In a panorama, planes through the
    camera and an edge are approximated as straight within a pixel.

    There are P eyes, a surface seen by P·K rays, and the pixels' upper left corners (P, 2). Rays
    are at `offsets` (K, 2) in a pixel, with shares `alike` (K,) where no outline is known.
    """
    rays = len(offsets)
    things = geometry.object_id[surface.triangle].reshape(-1, rays).astype(np.int64)
    weights = np.tile(alike, (len(things), 1))
    first = things[:, :1]
    differs = things != first
    second = np.take_along_axis(things, differs.argmax(axis=1)[:, None], axis=1)
    is_two = differs.any(axis=1) & ((things == second) | ~differs).all(axis=1)
    two = np.flatnonzero(is_two)
    triangle = surface.triangle.reshape(-1, rays)[two]
    nearest = surface.distance.reshape(-1, rays)[two].argmin(axis=1)[:, None]
    is_near = things[two] == np.take_along_axis(things[two], nearest, axis=1)
    # Some triangles fill many rays: each counts once per pixel.
    row, ray = np.nonzero(is_near)
    count = len(geometry.object_id)
    pixel, of_pixel = np.divmod(np.unique(row * count + triangle[row, ray]), count)
    own_eyes = eyes.of(two[pixel])
    corners = geometry.corners(of_pixel, own_eyes.time_s) - own_eyes.origin.reshape(-1, 1, 3)
    shape = corners.shape
    rows = np.searchsorted(pixel, np.arange(len(two) + 1))
    # Directions of three corners of each pixel end on a plane: those between are linear.
    corner_px = places[two][:, None] + np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.5]])
    toward = camera.toward(corner_px)
    axis = np.array([0.0, 0.0, 1.0]) if camera.intrinsics is not None else toward[:, 3:]
    axes = np.asarray((toward / (toward * axis).sum(axis=-1, keepdims=True))[:, :3])
    turned = eyes.of(two[np.repeat(pixel, 3)]).to_camera(corners.reshape(-1, 3)).reshape(shape)
    area = _covered(turned, rows, axes, offsets, is_near)
    known = np.isfinite(area)
    near, share = is_near[known], np.minimum(area[known, None], 1)
    weights[two[known]] = share * _divided(near, alike) + (1 - share) * _divided(~near, alike)
    return weights


def _divided(members: Mask, alike: Floats) -> Floats:
    """1 divided (P, K) among members (P, K); those in corners count only if there are no others."""
    parts = members * alike
    alone = ~parts.any(axis=1, keepdims=True)
    parts = np.where(alone, members, parts)
    return np.asarray(parts / parts.sum(axis=1, keepdims=True))


@compiled
def _covered(  # type: ignore[no-untyped-def]
    corners, first, axes, offsets, is_near
):
    """Area (P,) of pixels covered by triangles (M, 3, 3); NaN where the rays contradict it."""
    pixels, rays = is_near.shape
    area = np.zeros(pixels)
    lines = np.empty((3, 3))
    polygon, clipped = np.empty((_MOST_CORNERS, 2)), np.empty((_MOST_CORNERS, 2))
    hits, is_sure = np.empty(rays, np.int64), np.empty(rays, np.bool_)
    for pixel in range(pixels):
        for ray in range(rays):
            hits[ray], is_sure[ray] = 0, True
        for row in range(first[pixel], first[pixel + 1]):
            _edge_lines(corners[row], axes[pixel], lines)
            for ray in range(rays):
                x, y = offsets[ray, 0], offsets[ray, 1]
                inner = np.inf
                for edge in range(3):
                    inner = min(inner, lines[edge, 0] + lines[edge, 1] * x + lines[edge, 2] * y)
                hits[ray] += inner > 0
                is_sure[ray] &= abs(inner) > 1e-4  # px from the edge: it may be on either side
            area[pixel] += _clipped_area(lines, polygon, clipped)
        for ray in range(rays):
            if is_sure[ray] and hits[ray] != is_near[pixel, ray]:
                area[pixel] = np.nan
    return area


@compiled
def _edge_lines(triangle, axes, lines):  # type: ignore[no-untyped-def]
    """Set lines (3, 3): a + b·x + c·y is the distance of a place inside each edge, px."""
    for edge in range(3):
        u, v, w = triangle[edge], triangle[(edge + 1) % 3], triangle[(edge + 2) % 3]
        x = u[1] * v[2] - u[2] * v[1]
        y = u[2] * v[0] - u[0] * v[2]
        z = u[0] * v[1] - u[1] * v[0]
        side = np.sign(x * w[0] + y * w[1] + z * w[2])
        for corner in range(3):
            a = axes[corner]
            lines[edge, corner] = side * (x * a[0] + y * a[1] + z * a[2])
        lines[edge, 1] -= lines[edge, 0]
        lines[edge, 2] -= lines[edge, 0]
        steepness = max(np.hypot(lines[edge, 1], lines[edge, 2]), 1e-300)
        for corner in range(3):
            lines[edge, corner] /= steepness


@compiled
def _clipped_area(lines, polygon, clipped):  # type: ignore[no-untyped-def]
    """Area of the unit square on the positive side of three lines (Sutherland and Hodgman)."""
    count = 4
    for corner in range(4):
        polygon[corner, 0], polygon[corner, 1] = _SQUARE[corner, 0], _SQUARE[corner, 1]
    for edge in range(3):
        line, kept = lines[edge], 0
        for index in range(count):
            p, q = polygon[index], polygon[(index + 1) % count]
            at_p = line[0] + line[1] * p[0] + line[2] * p[1]
            at_q = line[0] + line[1] * q[0] + line[2] * q[1]
            if at_p > 0:
                clipped[kept, 0], clipped[kept, 1] = p[0], p[1]
                kept += 1
            if (at_p > 0) != (at_q > 0):
                part = at_p / (at_p - at_q)
                clipped[kept, 0] = p[0] + part * (q[0] - p[0])
                clipped[kept, 1] = p[1] + part * (q[1] - p[1])
                kept += 1
        count = kept
        for index in range(count):
            polygon[index, 0], polygon[index, 1] = clipped[index, 0], clipped[index, 1]
    area = 0.0
    for index in range(count):
        p, q = polygon[index], polygon[(index + 1) % count]
        area += (p[0] * q[1] - q[0] * p[1]) / 2
    return area
