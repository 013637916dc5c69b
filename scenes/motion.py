"""Motion of objects: rigid bodies on their own paths, and the protocol of any motion.

A motion maps a point of the object as placed to its position at a time, and back.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.core.record import Record

# Beyond this, squares of lengths lose precision for a forest, or overflow.
Coordinate = Annotated[float, Field(ge=-1e12, le=1e12)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Times = float | Floats


class Motion(Protocol):
    """Protocol of any motion; points are in world meters."""

    def carry(self, points: Floats, time_s: Times) -> Floats:
        """Return points (n, 3) of the object as placed at one time, or each at its own (n,)."""

    def undo(self, points: Floats, time_s: float) -> Floats:
        """Return points (n, 3) of a time, moved back to the object as placed."""

    def turn(self, normals: Floats, points: Floats, time_s: float) -> Floats:
        """Return unit normals (n, 3) at a time, from those at points (n, 3) as placed."""

    def record(self) -> dict[str, Any]:
        """Return the motion as numbers, for a file."""


class Drift(Record, frozen=True):
    """Steady velocity, and spin of a body about its own center; both may be zero."""

    spin_deg_s: float = 0.0
    """Turning rate about the object's center (degrees/s)."""

    spin_axis: Vector = (0.0, 0.0, 1.0)
    """Axis of the spin (x, y, z of any length), counterclockwise seen against it."""

    kind: Literal["steady"] = "steady"
    """Kind of motion."""

    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    """Velocity (x, y, z in m/s)."""

    @model_validator(mode="after")
    def _axis_has_a_direction(self) -> "Drift":
        if not any(self.spin_axis):
            raise ValueError("spin_axis (0, 0, 0) has no direction; give an axis such as (0, 0, 1)")
        return self

    def rotation(self, time_s: Times) -> Rotation:
        """Orientation at a time, or at times (n,), relative to that at 0."""
        axis = np.asarray(self.spin_axis) / np.linalg.norm(self.spin_axis)
        return Rotation.from_rotvec(np.multiply.outer(np.radians(self.spin_deg_s) * time_s, axis))

    def shift(self, time_s: Times) -> Floats:
        """Displacement (3,) since time 0, m; at times (n,) displacements (n, 3)."""
        return np.asarray(np.multiply.outer(time_s, self.velocity_m_s))


@dataclass(frozen=True)
class RigidMotion:
    """Motion of a rigid body: it turns about a moving point of its own."""

    center_m: Vector
    """(x, y, z): that point at time 0."""
    course: Drift
    """Motion of that point, and turn of the body about it."""

    def carry(self, points: Floats, time_s: Times) -> Floats:
        """Return points (n, 3) of the object as placed at one time, or each at its own (n,)."""
        turned = self.course.rotation(time_s).apply(points - self.center_m)
        return np.asarray(turned + (self.center_m + self.course.shift(time_s)))

    def undo(self, points: Floats, time_s: float) -> Floats:
        """Return points (n, 3) of a time, moved back to the object as placed."""
        offset = points - (self.center_m + self.course.shift(time_s))
        return np.asarray(self.course.rotation(time_s).inv().apply(offset) + self.center_m)

    def turn(self, normals: Floats, points: Floats, time_s: float) -> Floats:
        """Return unit normals (n, 3) at a time."""
        return np.asarray(self.course.rotation(time_s).apply(normals))

    def record(self) -> dict[str, Any]:
        """Return the motion as numbers, for a file."""
        return {"center_m": list(self.center_m), **self.course.model_dump(mode="json")}
