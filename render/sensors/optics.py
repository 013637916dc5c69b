"""Our cameras as Mitsuba's: a plugin's parameters, and how strips of rows are cut out of a frame.

A new camera registers both here.
"""

import math
from functools import singledispatch
from typing import Any

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.render import mi
from megalopta.render.mitsuba_loader import registered
from megalopta.render.sensors.plug_ins import Panorama
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
