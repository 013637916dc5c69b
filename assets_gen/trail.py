"""Trodden path: its course, local width and depth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from megalopta.assets_gen import FloatArray, unit
from megalopta.assets_gen.scatter import distance_to
from megalopta.assets_gen.tileable_noise import PlaneWaves, plane_waves

STEP_M = 0.2
"""Distance between points of the middle line (m)."""
CHORD_M = 0.5
"""Length of the last piece that sets the direction of the extension (m)."""
MARGIN_M = 1.0
"""Range around the mean margin in which the margin is uneven (m)."""


@dataclass(frozen=True)
class Trail:
    """Trodden path along a line."""

    line: cKDTree
    """Points of its middle (m)."""
    half_m: float
    """Half of its mean width (m)."""
    margin: PlaneWaves
    fringe: PlaneWaves
    """Unevenness of its margins, and depth of fraying (m)."""

    def inside(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (n, 2) from the margin (m): positive on the path.

        It is minus infinity beyond the reach of the margins.
        """
        away = distance_to(self.line, points, self.half_m + 2 * MARGIN_M)
        inside = self.half_m - away
        near = away < self.half_m + MARGIN_M
        inside[near] += self.margin(points[near])
        return inside

    def covers(self, points: FloatArray) -> NDArray[np.bool_]:
        """Return True for points (n, 2) (m) on bare soil."""
        inside = self.inside(points)
        near = np.abs(inside) < MARGIN_M
        inside[near] += self.fringe(points[near])
        return inside > 0

    def clear_of(
        self, points: FloatArray, from_middle_m: float, from_margin_m: float
    ) -> NDArray[np.bool_]:
        """Return True for points (n, 2) that keep distances from its middle and its margin (m)."""
        is_away = distance_to(self.line, points) >= from_middle_m
        return np.asarray(is_away & (self.inside(points) <= -from_margin_m))

    def sunk(self, inside_m: FloatArray) -> FloatArray:
        """Return the depth of wear at a distance inside the margin (m): 6 cm between its flanks."""
        share = np.clip(inside_m / min(0.35, self.half_m) + 0.5, 0, 1)
        return 0.06 * share**2 * (3 - 2 * share)


def make_trail(
    path_xy: FloatArray,
    heading: FloatArray,
    width_m: float,
    reach_m: float,
    rng: np.random.Generator,
) -> Trail:
    """Return a path of a mean width along a camera's path (n, 2), extended at both ends (m).

    It has the heading (2,) if the camera stays within half a meter.
    """
    ends = []
    for points in (path_xy[::-1], path_xy):
        far = np.flatnonzero(np.linalg.norm(points[-1] - points, axis=1) >= CHORD_M)
        chord = points[-1] - points[far[-1]] if len(far) else heading
        ends.append(unit(np.asarray(chord, dtype=float)))
    start, end = ends
    if np.linalg.norm(np.ptp(path_xy, axis=0)) < CHORD_M:
        start = -end
    way = np.arange(STEP_M, reach_m, STEP_M)
    extensions = []
    for place, direction in ((path_xy[0], start), (path_xy[-1], end)):
        turning = plane_waves((9.0, 25.0), 1.0, 8, rng)(np.column_stack([way, np.zeros_like(way)]))
        # Windings, with an rms curvature of 0.11 per m, are fully developed after 8 m.
        swing = 0.11 * turning * np.clip(way / 8.0, 0, 1)
        # A path swings about its direction: part of each turn is reversed.
        angle = np.zeros(len(way))
        for i in range(1, len(way)):
            angle[i] = angle[i - 1] + STEP_M * (swing[i] - 0.12 * angle[i - 1])
        azimuth = np.arctan2(direction[1], direction[0]) + angle
        steps = STEP_M * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
        extensions.append(place + np.cumsum(steps, axis=0))
    behind, ahead = extensions
    return Trail(
        cKDTree(np.concatenate([behind[::-1], path_xy, ahead])),
        width_m / 2,
        margin=plane_waves((0.5, 4.0), 0.12 * width_m**0.5, 40, rng),
        fringe=plane_waves((0.12, 0.6), 0.09, 40, rng),
    )
