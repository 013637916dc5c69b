"""Our cameras as Mitsuba's sensors, and one that is elsewhere for every time and row.

A new camera registers here its plug-in's parameters, and how strips of rows are cut out of a frame.

Vectorized variants trace sensors written in Python into their kernel once, which costs nothing;
scalar variants call them for every sample, which takes a few microseconds of one core each.
"""

import math
from collections.abc import Sequence
from functools import singledispatch
from typing import Any

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.render import dr, mi
from megalopta.render.mitsuba_loader import PlugIn, is_scalar, registered
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.cameras.panoramic import PanoramicCamera
from megalopta.scenes.cameras.perspective import PerspectiveCamera


@singledispatch
def plugin(camera: Camera) -> dict[str, Any]:
    """Mitsuba's sensor of a camera, without film and sampler."""
    raise NotImplementedError(f"no Mitsuba sensor for a {camera}")


@singledispatch
def cut_strip(camera: Camera, parameters: Any, first_row: int, rows: int) -> None:
    """Set a sensor, by its `mi.traverse` parameters, to a strip of rows of the camera's frame."""
    raise NotImplementedError(f"no strips of a {camera}")


@plugin.register
def _(camera: PerspectiveCamera) -> dict[str, Any]:
    clip = {"near_clip": 1e-3, "far_clip": 1e5}
    return {"type": "perspective", "fov": camera.fov_deg, "fov_axis": "x", **clip}


@cut_strip.register
def _(camera: PerspectiveCamera, parameters: Any, first_row: int, rows: int) -> None:
    parameters["principal_point_offset_y"] = 0.5 - (camera.height / 2 - first_row) / rows


@plugin.register
def _(camera: PanoramicCamera) -> dict[str, Any]:
    fov = math.radians(camera.fov_deg)
    return {"type": registered(Panorama), "fov": fov, "is_cylinder": camera.is_cylinder}


@cut_strip.register
def _(camera: PanoramicCamera, parameters: Any, first_row: int, rows: int) -> None:
    lower, upper = camera.heights
    per_row = (upper - lower) / camera.height
    top = upper - first_row * per_row
    parameters["heights"] = mi.Point2f(top - rows * per_row, top)


def sensor_transform(pose: Floats) -> Floats:
    """The matrix of a pose (..., 4, 4) for Mitsuba, which looks along +z with +x left, +y up."""
    return np.asarray(pose @ np.diag([-1.0, -1.0, 1.0, 1.0]))


class PythonSensor(PlugIn):
    """What sensors that define `sample_ray` have in common."""

    base = "Sensor"

    def sample_ray_differential(
        self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
    ) -> tuple[Any, Any]:
        """Return a ray as Mitsuba's own integrators ask for it, and its weight."""
        ray, weight = self.sample_ray(time, sample1, sample2, sample3, active)
        return mi.RayDifferential3f(ray), weight


class Panorama(PythonSensor):
    """Rays from one point, uniform in azimuth and in height on the film.

    Plugin parameters: `fov`, the azimuth (rad) from the left to the right edge, and
    `is_cylinder`, whether height is the tangent of elevation or elevation itself. Through
    `mi.traverse` one sets `to_world` and `heights`, those of the lower and upper edge in focal
    lengths; that compiles nothing again.
    """

    def __init__(self, properties: Any) -> None:
        self.above.__init__(self, properties)
        self.to_world = mi.Transform4f()
        self.fov = properties["fov"]
        self.is_cylinder = properties["is_cylinder"]
        # Not two numbers: scalar variants can change only Mitsuba's own objects.
        self.heights = mi.Point2f(0)

    def traverse(self, callback: Any) -> None:
        """Tell Mitsuba what can be set."""
        self.above.traverse(self, callback)
        for name in ("to_world", "heights"):
            callback.put(name, getattr(self, name), mi.ParamFlags.NonDifferentiable)

    def parameters_changed(self, keys: Sequence[str] = ()) -> None:
        """Keep values out of the kernel."""
        if not is_scalar():  # else the values would be written into the kernel
            dr.make_opaque(self.to_world, self.heights)

    def sample_ray(
        self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
    ) -> tuple[Any, Any]:
        """Return a ray through the film, and its weight."""
        surface = dr.zeros(mi.SurfaceInteraction3f)
        wavelengths, weight = self.sample_wavelengths(surface, sample1, active)
        sine, cosine = dr.sincos(self.fov * (sample2.x - 0.5))
        height = dr.lerp(self.heights.y, self.heights.x, sample2.y)
        if self.is_cylinder:
            radius, rise = dr.rsqrt(1 + height * height), height * dr.rsqrt(1 + height * height)
        else:
            rise, radius = dr.sincos(height)
        # Mitsuba's +x is to the left of its +z.
        direction = mi.Vector3f(-radius * sine, rise, radius * cosine)
        origin = self.to_world @ mi.Point3f(0, 0, 0)
        ray = mi.Ray3f(origin, self.to_world @ direction, time, wavelengths)
        return ray, weight


class Rows(PythonSensor):
    """Rays of `optics`, a sensor at Mitsuba's identity, moved by time and row.

    Loaded with `shutter_open` 0 and `shutter_close` 1, so that samplers spread the samples of a
    pixel evenly over the times.
    """

    optics: Any = None
    times, rows = 0, 0
    to_world: Any = None

    def move(self, to_world: Floats) -> None:
        """Set the transforms (times, rows, 4, 4); one row stands for all of them."""
        self.times, self.rows = to_world.shape[:2]
        if not is_scalar():
            self.to_world = mi.Float(to_world.astype(np.float32).ravel())
        else:
            matrices = to_world.reshape(-1, 4, 4).tolist()
            self.to_world = [mi.Transform4f(matrix) for matrix in matrices]

    def _transform(self, time: Any, y: Any) -> Any:
        if is_scalar():
            moment = min(int(time * self.times), self.times - 1)
            return self.to_world[moment * self.rows + min(int(y * self.rows), self.rows - 1)]
        moments = dr.minimum(mi.UInt32(time * self.times), self.times - 1)
        rows = dr.minimum(mi.UInt32(y * self.rows), self.rows - 1)
        place = moments * self.rows + rows
        return mi.Transform4f(dr.gather(mi.Matrix4f, self.to_world, place))

    def sample_ray(
        self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
    ) -> tuple[Any, Any]:
        """Return a ray of the optics, moved, and its weight."""
        ray, weight = self.optics.sample_ray(time, sample1, sample2, sample3, active)
        transform = self._transform(time, sample2.y)
        ray.o, ray.d = transform @ ray.o, transform @ ray.d
        return ray, weight
