"""A sensor whose rows look from poses of their own, for the rolling shutter.

It takes the rays of an ordinary sensor that stands at the origin and carries them to the pose of
their row.
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi
from megalopta.render.sensors.base import python_sensor

ROWS = "rows"


@cache
def register_rows(variant: str) -> None:
    """Make the sensor known to the active variant, given by its name."""
    is_vectorized = not variant.startswith("scalar")

    class RowsSensor(python_sensor()):  # type: ignore[misc]
        """Rays of `optics`, a sensor at Mitsuba's identity, moved row by row."""

        optics: Any = None
        rows = 0
        to_world: Any = None

        def move(self, to_world: NDArray[np.float64]) -> None:
            """Set the transforms (rows, 4, 4)."""
            self.rows = len(to_world)
            if is_vectorized:
                self.to_world = mi.Float(to_world.astype(np.float32).ravel())
            else:
                self.to_world = [mi.Transform4f(matrix) for matrix in to_world.tolist()]

        def _transform(self, y: Any) -> Any:
            if not is_vectorized:
                return self.to_world[min(int(y * self.rows), self.rows - 1)]
            row = dr.minimum(mi.UInt32(y * self.rows), self.rows - 1)
            return mi.Transform4f(dr.gather(mi.Matrix4f, self.to_world, row))

        def sample_ray(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> tuple[Any, Any]:
            ray, weight = self.optics.sample_ray(time, sample1, sample2, sample3, active)
            transform = self._transform(sample2.y)
            ray.o, ray.d = transform @ ray.o, transform @ ray.d
            return ray, weight

    mi.register_sensor(ROWS, RowsSensor)
