"""Camera on a smooth curve through listed points."""

from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator
from scipy.interpolate import CubicSpline

from megalopta.core.arrays import Floats
from megalopta.scenes.motion import Vector
from megalopta.scenes.trajectories.base import Path, is_upright, looking


class Spline(Path, frozen=True):
    """Cubic spline (C²) from the first point at the first frame to the last at the last frame.

    The time between points is proportional to their distance, so the speed is nearly constant.
    """

    kind: Literal["spline"] = "spline"

    points_m: Annotated[tuple[Vector, ...], Field(min_length=2)] = ((0, 0, 1.5), (3, 0, 1.5))
    """Points to pass through (x, y, z in m; z is up)."""

    look_at_m: Vector | None = None
    """Point at the image center (x, y, z in m); null: look along the curve."""

    up: Vector = (0.0, 0.0, 1.0)
    """Direction that is up in the image."""

    @field_validator("points_m")
    @classmethod
    def _points_differ(cls, points: tuple[Vector, ...]) -> tuple[Vector, ...]:
        for first, second in pairwise(points):
            if first == second:
                raise ValueError(f"the point {first} occurs twice in a row: omit one of them")
        return points

    @model_validator(mode="after")
    def _view_is_defined(self) -> "Spline":
        curve = self._curve()
        times = np.linspace(0, self.duration_s, 1000)
        if is_upright(self._views(curve, times), self.up):
            view = "look_at_m" if self.look_at_m else "the direction of the curve"
            raise ValueError(
                f"up {self.up} is parallel to the view somewhere on the way, or the view has no "
                f"direction there: change up, points_m or {view}"
            )
        return self

    def course(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Positions (n, 3), m, and rotations (n, 3, 3), camera axes to world."""
        curve = self._curve()
        return curve(times_s), looking(self._views(curve, times_s), self.up)

    def _curve(self) -> CubicSpline:
        points = np.array(self.points_m)
        way = np.linalg.norm(np.diff(points, axis=0), axis=1)
        place = np.concatenate([[0.0], np.cumsum(way)])
        return CubicSpline(place / place[-1] * self.duration_s, points)

    def _views(self, curve: CubicSpline, times_s: Floats) -> Floats:
        if self.look_at_m is None:
            return np.asarray(curve(times_s, 1))
        return np.asarray(self.look_at_m - curve(times_s))

    def __str__(self) -> str:
        """Camera motion."""
        view = "ahead" if self.look_at_m is None else "at one point"
        return f"follows a smooth curve through {len(self.points_m)} points, looking {view}"
