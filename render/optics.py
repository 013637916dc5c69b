"""Cameras as Mitsuba sensors, and one with a pose for every time and row.

Mitsuba has its own perspective sensor; every other camera uses the directions of its `toward`.

Vectorized variants trace sensors written in Python into their kernel once, at no cost; scalar
variants call them for every sample, at a few microseconds of one core each.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.render import dr, mi
from megalopta.render.mitsuba_loader import PlugIn, is_scalar, registered
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.cameras.perspective import PerspectiveCamera

_MOST_DIRECTIONS, _MOST_PARTS = 2_000_000, 8


def plugin(camera: Camera, on_side: bool = False) -> dict[str, Any]:
    """Mitsuba sensor of a camera, without film and sampler; `on_side` swaps rows and columns."""
    if isinstance(camera, PerspectiveCamera) and not on_side:
        clip = {"near_clip": 1e-3, "far_clip": 1e5}
        return {"type": "perspective", "fov": camera.fov_deg, "fov_axis": "x", **clip}
    parts = math.isqrt(_MOST_DIRECTIONS // (camera.width * camera.height))
    parts = min(max(parts, 1), _MOST_PARTS)
    columns, rows = (np.arange(size * parts + 1) / parts for size in (camera.width, camera.height))
    directions = camera.toward(np.stack(np.meshgrid(columns, rows), axis=-1)).astype(np.float32)
    table = np.ascontiguousarray(directions.swapaxes(0, 1)) if on_side else directions
    return {"type": registered(Directions), "directions": mi.TensorXf(table)}


def cut_strip(parameters: Any, height: int, first_row: int, rows: int) -> None:
    """Set a sensor, through its `mi.traverse` parameters, to a strip of rows of a film."""
    if "strip" in parameters:
        parameters["strip"] = mi.Point2f(first_row / height, rows / height)
    else:
        parameters["principal_point_offset_y"] = 0.5 - (height / 2 - first_row) / rows


def sensor_transform(pose: Floats) -> Floats:
    """Matrix of a pose (..., 4, 4) for Mitsuba, which looks along +z with +x left, +y up."""
    return np.asarray(pose @ np.diag([-1.0, -1.0, 1.0, 1.0]))


class PythonSensor(PlugIn):
    """Base of sensors that define `sample_ray`."""

    base = "Sensor"

    def sample_ray_differential(
        self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
    ) -> tuple[Any, Any]:
        """Return a ray, as Mitsuba's own integrators request it, and its weight."""
        ray, weight = self.sample_ray(time, sample1, sample2, sample3, active)
        return mi.RayDifferential3f(ray), weight


class Directions(PythonSensor):
    """Rays from one point, in the directions of any camera.

    Plugin parameter: `directions` (h, w, 3) at the corners of the film and evenly between them;
    they are interpolated. `mi.traverse` sets `to_world` and `strip`, the first row and the number
    of rows of the film, relative to those of the camera, without recompilation.
    """

    def __init__(self, properties: Any) -> None:
        self.above.__init__(self, properties)
        self.to_world = mi.Transform4f()
        # Not two numbers: scalar variants can change only Mitsuba's own objects.
        self.strip = mi.Point2f(0, 1)
        directions = properties["directions"]
        self.rows, self.columns, _ = directions.shape
        texture: Any = mi.Texture2f
        self.table = texture(directions, use_accel=False)

    def traverse(self, callback: Any) -> None:
        """Declare the settable parameters to Mitsuba."""
        self.above.traverse(self, callback)
        for name in ("to_world", "strip"):
            callback.put(name, getattr(self, name), mi.ParamFlags.NonDifferentiable)

    def parameters_changed(self, keys: Sequence[str] = ()) -> None:
        """Keep values out of the kernel."""
        if not is_scalar():  # otherwise the values would be written into the kernel
            dr.make_opaque(self.to_world, self.strip)

    def sample_ray(
        self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
    ) -> tuple[Any, Any]:
        """Return a ray through the film, and its weight."""
        surface = dr.zeros(mi.SurfaceInteraction3f)
        wavelengths, weight = self.sample_wavelengths(surface, sample1, active)
        height = self.strip.x + self.strip.y * sample2.y
        # the center of the first texel is at the corner of the film, so half of it is outside
        place = mi.Point2f(
            (sample2.x * (self.columns - 1) + 0.5) / self.columns,
            (height * (self.rows - 1) + 0.5) / self.rows,
        )
        right, down, forward = self.table.eval(place)
        # Mitsuba's +x is to the left of its +z.
        direction = dr.normalize(mi.Vector3f(-right, -down, forward))
        origin = self.to_world @ mi.Point3f(0, 0, 0)
        ray = mi.Ray3f(origin, self.to_world @ direction, time, wavelengths)
        return ray, weight


class Rows(PythonSensor):
    """Rays of `optics`, a sensor at Mitsuba's identity, transformed by time and row.

    It is loaded with `shutter_open` 0 and `shutter_close` 1, so that samplers spread the samples of
    a pixel evenly over the times.
    """

    optics: Any = None
    times, rows = 0, 0
    to_world: Any = None

    def move(self, to_world: Floats) -> None:
        """Set the transforms (times, rows, 4, 4); a single row holds for all."""
        self.times, self.rows = to_world.shape[:2]
        if not is_scalar():
            self.to_world = mi.Float(to_world.astype(np.float32).ravel())
        else:
            matrices = to_world.reshape(-1, 4, 4).tolist()
            self.to_world = [mi.Transform4f(matrix) for matrix in matrices]

    def sample_ray(
        self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
    ) -> tuple[Any, Any]:
        """Return a transformed ray of the optics, and its weight."""
        ray, weight = self.optics.sample_ray(time, sample1, sample2, sample3, active)
        if is_scalar():
            moment = min(int(time * self.times), self.times - 1)
            row = min(int(sample2.y * self.rows), self.rows - 1)
            transform = self.to_world[moment * self.rows + row]
        else:
            moments = dr.minimum(mi.UInt32(time * self.times), self.times - 1)
            rows = dr.minimum(mi.UInt32(sample2.y * self.rows), self.rows - 1)
            matrices = dr.gather(mi.Matrix4f, self.to_world, moments * self.rows + rows)
            transform = mi.Transform4f(matrices)
        ray.o, ray.d = transform @ ray.o, transform @ ray.d
        return ray, weight
