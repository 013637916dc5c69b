"""Camera that turns in place, moves along a line, or both; or is held in place with jitter."""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from megalopta.assets_gen import generator
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


_WAVES = 48


class Hover(Aimed, frozen=True):
    """Fixed pose with random jitter of limited bandwidth, as of a hovering animal or drone.

    Each of the six degrees of freedom is a sum of sines of random phase, with frequencies spread
    evenly up to the bandwidth: nearly Gaussian, smooth, and defined at any time.
    """

    kind: Literal["hover"] = "hover"
    jitter_m: Annotated[float, Field(ge=0)] = 0.02
    """Root mean square of the position along each axis (m)."""
    jitter_deg: Annotated[float, Field(ge=0, le=30)] = 1.0
    """Root mean square of the angle about each camera axis (degrees)."""
    bandwidth_hz: Annotated[float, Field(gt=0)] = 2.0
    """Highest frequency of the jitter (Hz)."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Random seed of the jitter."""

    def course(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Positions (n, 3), m, and rotations (n, 3, 3), camera axes to world."""
        # Six independent signals of mean square 1 over long times.
        rng = generator(self.seed, "hover")
        # One frequency from each of equal intervals: no gap in the band, no common period.
        place = (np.arange(_WAVES) + rng.random((6, _WAVES))) / _WAVES
        phase = rng.uniform(0, 2 * np.pi, (6, _WAVES))
        rate = 2 * np.pi * self.bandwidth_hz * place
        jitter = np.zeros((len(times_s), 6))
        for wave in range(_WAVES):  # one at a time: times may be as many as pixels
            jitter += np.sin(times_s[:, None] * rate[:, wave] + phase[:, wave])
        jitter *= np.sqrt(2 / _WAVES)
        first = looking(np.subtract(self.look_at_m, self.position_m)[None], self.up)
        turns = Rotation.from_rotvec(np.radians(self.jitter_deg) * jitter[:, 3:]).as_matrix()
        return np.asarray(self.position_m) + self.jitter_m * jitter[:, :3], first @ turns

    def __str__(self) -> str:
        """Camera motion."""
        return (
            f"hovers in place with a jitter of {100 * self.jitter_m:g} cm and "
            f"{self.jitter_deg:g}° up to {self.bandwidth_hz:g} Hz"
        )
