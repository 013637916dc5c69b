"""Camera that turns in place, moves along a line, or both."""

import math
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.scenes.motion import Vector
from megalopta.scenes.trajectories.base import Aimed, looking


class Trajectory(Aimed, frozen=True):
    """Steady rotation about `up` together with steady translation; either rate may be zero."""

    kind: Literal["steady"] = "steady"

    rotation_deg_s: float = 0.0
    """Turning rate about `up` (degrees/s); positive turns left, so that the image moves right."""

    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    """Velocity (x, y, z in m/s)."""

    def course(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Positions (n, 3), m, and rotations (n, 3, 3), camera axes to world."""
        up = np.asarray(self.up) / np.linalg.norm(self.up)
        angles = np.radians(self.rotation_deg_s) * times_s
        turns = Rotation.from_rotvec(angles[:, None] * up).as_matrix()
        first = looking(np.subtract(self.look_at_m, self.position_m)[None], up)
        positions = np.asarray(self.position_m) + times_s[:, None] * np.asarray(self.velocity_m_s)
        return positions, turns @ first

    def __str__(self) -> str:
        """Camera motion."""
        speed, turn = math.hypot(*self.velocity_m_s), self.rotation_deg_s
        side = "left" if turn > 0 else "right"
        turning = f"turns {side} by {abs(turn):g}° per second" if turn else ""
        moving = f"moves at {speed:.3g} m per second" if speed else ""
        return " and ".join(part for part in (turning, moving) if part) or "stands still"
