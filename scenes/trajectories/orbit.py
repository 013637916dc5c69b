"""Camera on a circle around the point at which it looks."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.scenes.motion import Vector
from megalopta.scenes.trajectories.base import Path, looking


class Orbit(Path, frozen=True):
    """Level circle around a point, which stays at the image center."""

    kind: Literal["orbit"] = "orbit"

    center_m: Vector = (0.0, 0.0, 1.5)
    """Point at the image center (x, y, z in m; z is up)."""

    radius_m: Annotated[float, Field(gt=0)] = 5.0
    """Radius of the circle (m)."""

    height_m: float = 0.0
    """Height of the circle above the point (m)."""

    rate_deg_s: float = 10.0
    """Angular rate (degrees/s); positive is counterclockwise seen from above."""

    start_deg: float = 180.0
    """Position of the first frame on the circle (degrees from +x toward +y)."""

    def course(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Positions (n, 3), m, and rotations (n, 3, 3), camera axes to world."""
        angle = np.radians(self.start_deg + self.rate_deg_s * times_s)
        outward = np.stack(
            [
                self.radius_m * np.cos(angle),
                self.radius_m * np.sin(angle),
                np.full_like(angle, self.height_m),
            ],
            axis=-1,
        )
        return np.asarray(self.center_m) + outward, looking(-outward, (0, 0, 1))

    def __str__(self) -> str:
        """Camera motion."""
        return (
            f"circles a point at {self.radius_m:g} m by {abs(self.rate_deg_s):g}° per second, "
            "looking at it"
        )
