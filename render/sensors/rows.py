"""A sensor that is somewhere else for every time of the exposure, and for every row.

It takes the rays of an ordinary sensor that stands at the origin and carries them to the pose of
their time and row.
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
        """Rays of `optics`, a sensor at Mitsuba's identity, moved by time and row.

        Loaded with `shutter_open` 0 and `shutter_close` 1, so that samplers spread the samples of a
        pixel evenly over the times.
        """

        optics: Any = None
        times, rows = 0, 0
        to_world: Any = None

        def move(self, to_world: NDArray[np.float64]) -> None:
            """Set the transforms (times, rows, 4, 4); one row stands for all of them."""
            self.times, self.rows = to_world.shape[:2]
            if is_vectorized:
                self.to_world = mi.Float(to_world.astype(np.float32).ravel())
            else:
                matrices = to_world.reshape(-1, 4, 4).tolist()
                self.to_world = [mi.Transform4f(matrix) for matrix in matrices]

        def _transform(self, time: Any, y: Any) -> Any:
            if not is_vectorized:
                moment = min(int(time * self.times), self.times - 1)
                return self.to_world[moment * self.rows + min(int(y * self.rows), self.rows - 1)]
            moments = dr.minimum(mi.UInt32(time * self.times), self.times - 1)
            rows = dr.minimum(mi.UInt32(y * self.rows), self.rows - 1)
            place = moments * self.rows + rows
            return mi.Transform4f(dr.gather(mi.Matrix4f, self.to_world, place))

        def sample_ray(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> tuple[Any, Any]:
            ray, weight = self.optics.sample_ray(time, sample1, sample2, sample3, active)
            transform = self._transform(time, sample2.y)
            ray.o, ray.d = transform @ ray.o, transform @ ray.d
            return ray, weight

    mi.register_sensor(ROWS, RowsSensor)
