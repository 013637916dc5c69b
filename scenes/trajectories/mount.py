"""Place of a camera on a rig that follows a path."""

from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.core.record import Record

_Offset = Annotated[float, Field(ge=-1e3, le=1e3)]
_Degrees = Annotated[float, Field(ge=-360, le=360)]


class Mount(Record, frozen=True):
    """Position and rotation of a camera relative to the path's own camera."""

    position_m: tuple[_Offset, _Offset, _Offset] = (0.0, 0.0, 0.0)
    """Position to the right of, below and ahead of the path's camera (m)."""

    rotation_deg: tuple[_Degrees, _Degrees, _Degrees] = (0.0, 0.0, 0.0)
    """Rotation vector (degrees) about the path's camera axes right, down and forward: (0, 90, 0)
    looks to the right. Its direction is the axis, its length the angle."""

    @property
    def matrix(self) -> Floats:
        """Matrix (4, 4) from this camera's axes to those of the path's camera."""
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_rotvec(self.rotation_deg, degrees=True).as_matrix()
        matrix[:3, 3] = self.position_m
        return matrix

    def baseline_m(self, other: "Mount") -> float | None:
        """Distance along x to another camera, m, positive to the right.

        None unless both look the same way and stand side by side, as in rectified stereo.
        """
        step = np.linalg.inv(self.matrix) @ other.matrix
        length = np.linalg.norm(step[:3, 3])
        is_rectified = np.allclose(step[:3, :3], np.eye(3), rtol=0, atol=1e-9)
        is_beside = np.abs(step[1:3, 3]).max() <= 1e-9 * length
        return float(step[0, 3]) if length and is_rectified and is_beside else None
