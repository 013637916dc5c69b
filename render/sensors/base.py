"""What Mitsuba's sensors written in Python have in common.

Vectorized variants trace them into their kernel once, which costs nothing; scalar variants call
them for every sample, which takes a few microseconds of one core each.
"""

from typing import Any

from megalopta.render import mi


def python_sensor() -> Any:
    """Base class, in the active variant, of sensors that define `sample_ray`."""

    class PythonSensor(mi.Sensor):
        def sample_ray_differential(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> tuple[Any, Any]:
            ray, weight = self.sample_ray(time, sample1, sample2, sample3, active)
            return mi.RayDifferential3f(ray), weight

        def to_string(self) -> str:
            return f"{type(self).__name__}[film = {self.film()}]"

    return PythonSensor
