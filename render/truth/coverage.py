"""Share of a pixel that each of its rays represents.

Shares are equal, unless a pixel contains two objects and the outline of the nearer one is known.
Then the triangles of the nearer object that rays hit are clipped to the pixel, which gives its
share exactly even for few rays, and the rays on each side divide their side among them. The outline
counts as known if every ray of the pixel, except on edges, hits the nearer object exactly where one
of these triangles is, and only one. Any part that a straight outline cuts off a pixel contains a
corner: so rays in the corners, which have no share themselves, find it.

A triangle covers the directions between the three planes through the camera and its edges, also
where it extends behind the camera. In a pinhole image these planes are straight lines; in a
panorama they are approximated as straight within a pixel.
"""

from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Mask
from megalopta.core.compiling import compiled
from megalopta.render.truth.geometry import Eyes, Geometry, Surface
from megalopta.scenes.cameras.base import Camera

# In compiled loops numbers are set one by one: an assignment to a row takes seconds to compile.

# The square clipped by three lines.
_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
_MOST_CORNERS = 8
# Within this distance of an edge, in px, a ray may be on either side.
_ON_EDGE_PX = 1e-4


class Probes(NamedTuple):
    """K rays of a pixel."""

    offsets: Floats
    """(K, 2): positions in the pixel, 0 to 1."""
    alike: Floats
    """(K,): shares if the outline is not known; 0 for rays in corners."""


def ray_weights(
    geometry: Geometry, camera: Camera, eyes: Eyes, surface: Surface, places: Floats, probes: Probes
) -> Floats:
    """Share of the pixel (P, K) of each of K rays in P pixels, which sum to 1.

    There are P eyes, a surface seen by P·K rays, and the pixels' upper left corners (P, 2).
    """
    offsets, alike = probes
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
    """Area (P,) of pixels covered by triangles; NaN where the rays contradict it.

    `corners` (M, 3, 3) are in camera axes; pixel p has rows first[p] to first[p + 1].
    """
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
                is_sure[ray] &= abs(inner) > _ON_EDGE_PX
            area[pixel] += _clipped_area(lines, polygon, clipped)
        for ray in range(rays):
            if is_sure[ray] and hits[ray] != is_near[pixel, ray]:
                area[pixel] = np.nan
    return area


@compiled
def _edge_lines(triangle, axes, lines):  # type: ignore[no-untyped-def]
    """Set lines (3, 3): a + b·x + c·y is the distance of a place inside each edge, px."""
    for edge in range(3):
        u, v, rest = triangle[edge], triangle[(edge + 1) % 3], triangle[(edge + 2) % 3]
        x = u[1] * v[2] - u[2] * v[1]
        y = u[2] * v[0] - u[0] * v[2]
        z = u[0] * v[1] - u[1] * v[0]
        side = np.sign(x * rest[0] + y * rest[1] + z * rest[2])
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
