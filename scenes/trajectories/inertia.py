"""Angular velocity and specific force of a body on a path, from its exact course.

An accelerometer measures a − g, along its own axes: at rest, 9.80665 m/s² upward. Derivatives are
central differences over 1 ms, extrapolated to fourth order (Richardson). They have an error below
1e-6 of the largest value for motion up to 5 Hz. Where a course has a corner, as recorded
orientations at each line of the file, it is rounded over 2 ms.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.scenes.trajectories.base import Path

GRAVITY_M_S2 = 9.80665
_STEP_S = 1e-3


@dataclass(frozen=True)
class Inertia:
    """Motion of a body at n times."""

    times_s: Floats
    """(n,)"""
    positions: Floats
    """(n, 3), m."""
    rotations: Floats
    """(n, 3, 3), body axes to world."""
    velocities: Floats
    """(n, 3), m/s, world axes."""
    angular_velocities: Floats
    """(n, 3), rad/s, body axes."""
    specific_forces: Floats
    """(n, 3), m/s², body axes."""


def inertia(path: Path, times_s: Floats) -> Inertia:
    """Return the motion of the camera on a path, whose axes are the body's, at times (n,), s."""
    positions, rotations = path.placed(times_s)
    (speed, turn, push), (speed_2, turn_2, push_2) = (
        _differences(path, times_s, positions, step) for step in (_STEP_S, 2 * _STEP_S)
    )
    acceleration = (4 * push - push_2) / 3 + [0, 0, GRAVITY_M_S2]
    return Inertia(
        times_s=times_s,
        positions=positions,
        rotations=rotations,
        velocities=(4 * speed - speed_2) / 3,
        angular_velocities=(4 * turn - turn_2) / 3,
        specific_forces=np.einsum("nij,ni->nj", rotations, acceleration),
    )


def _differences(
    path: Path, times_s: Floats, positions: Floats, step_s: float
) -> tuple[Floats, Floats, Floats]:
    """Velocity, angular velocity in body axes, and acceleration, each (n, 3), to second order."""
    (before, start), (after, end) = (path.placed(times_s + step) for step in (-step_s, step_s))
    turn = Rotation.from_matrix(start.swapaxes(1, 2) @ end).as_rotvec()
    speed = (after - before) / (2 * step_s)
    return speed, turn / (2 * step_s), (after - 2 * positions + before) / step_s**2
