"""Film of a camera: frames in passes, at an instant or over an exposure.

A running kernel cannot be interrupted and holds its whole strip in memory, so passes are short:
strips of rows, which keep each pixel's stratified samples together, then repeats of a row.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render import Bands, RenderSettings, dr, mi
from megalopta.render.mitsuba_loader import PlugIn, is_scalar, registered
from megalopta.render.settings import part_seed
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.cameras.perspective import PerspectiveCamera


def plan_passes(width: int, height: int, samples: int, most: int) -> tuple[int, int, int]:
    """Divide a frame into the fewest passes of at most `most` samples each.

    Returns rows per strip, of which the last may extend beyond the frame, samples per pixel of a
    pass, and passes per strip. A pass has at least one sample of every pixel of a row.
    """
    strips = math.ceil(height / max(most // (width * samples), 1))
    repeats = math.ceil(samples / max(most // width, 1))
    return math.ceil(height / strips), math.ceil(samples / repeats), repeats


_MOST_DIRECTIONS, _MOST_PARTS = 2_000_000, 8


def plugin(camera: Camera, on_side: bool = False) -> dict[str, Any]:
    """Mitsuba sensor of a camera, without film and sampler; `on_side` swaps rows and columns."""
    if isinstance(camera, PerspectiveCamera) and not (on_side or camera.lens_m):
        clip = {"near_clip": 1e-3, "far_clip": 1e5}
        return {"type": "perspective", "fov": camera.fov_deg, "fov_axis": "x", **clip}
    parts = math.isqrt(_MOST_DIRECTIONS // (camera.width * camera.height))
    parts = min(max(parts, 1), _MOST_PARTS)
    columns, rows = (np.arange(size * parts + 1) / parts for size in (camera.width, camera.height))
    directions = camera.toward(np.stack(np.meshgrid(columns, rows), axis=-1)).astype(np.float32)
    table = np.ascontiguousarray(directions.swapaxes(0, 1)) if on_side else directions
    lens = dict(zip(("aperture_radius", "focus_distance"), camera.lens_m or (), strict=False))
    return {"type": registered(Directions), "directions": mi.TensorXf(table), **lens}


def sensor_transform(pose: Floats) -> Floats:
    """Matrix of a pose (..., 4, 4) for Mitsuba, which looks along +z with +x left, +y up."""
    return np.asarray(pose @ np.diag([-1.0, -1.0, 1.0, 1.0]))


class _PythonSensor(PlugIn):
    """Base of sensors that define `sample_ray`, traced into vectorized kernels at no cost."""

    base = "Sensor"

    def sample_ray_differential(
        self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
    ) -> tuple[Any, Any]:
        """Return a ray, as Mitsuba's own integrators request it, and its weight."""
        ray, weight = self.sample_ray(time, sample1, sample2, sample3, active)
        return mi.RayDifferential3f(ray), weight


class Directions(_PythonSensor):
    """Rays from one point or a lens around it, in the directions of any camera.

    Plugin parameter: `directions` (h, w, 3) at the corners of the film and evenly between them;
    they are interpolated. Those of a thin lens, with `aperture_radius` and `focus_distance`, start
    anywhere on it and meet the ray through its middle in the plane in focus. `mi.traverse` sets
    `to_world` and `strip`, the first row and the number of rows of the film, relative to those of
    the camera, without recompilation.
    """

    def __init__(self, properties: Any) -> None:
        self.above.__init__(self, properties)
        self.to_world = mi.Transform4f()
        # Not two numbers: scalar variants can change only Mitsuba's own objects.
        self.strip = mi.Point2f(0, 1)
        radius, focus = (properties.get(x, 0.0) for x in ("aperture_radius", "focus_distance"))
        self.lens = mi.Point2f(radius, focus) if radius else None
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
            dr.make_opaque(self.to_world, self.strip, self.lens)

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
        start = mi.Point3f(0, 0, 0)
        if self.lens is not None:
            disc = mi.warp.square_to_uniform_disk_concentric(sample3) * self.lens.x
            start = mi.Point3f(disc.x, disc.y, 0)
            direction = dr.normalize(direction * (self.lens.y / direction.z) - mi.Vector3f(start))
        origin = self.to_world @ start
        ray = mi.Ray3f(origin, self.to_world @ direction, time, wavelengths)
        return ray, weight


def lens_of(sensor: Any) -> Any:
    """Return the lens of a sensor, or None if it looks from one point."""
    return getattr(sensor, "lens", None)


class Rows(_PythonSensor):
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


# At most a second's work on a small machine, so that Ctrl-C acts soon.
SAMPLES_PER_PASS = {"cuda": 2**24, "llvm": 2**20, "scalar": 2**19}


@dataclass(frozen=True)
class ExposurePart:
    """Part of an exposure, in which moving objects are at rest."""

    poses: Floats
    """(K, L, 4, 4): camera to world at K times, for all lines (L = 1) or for each (L = H, or W of
    columns); (4, 4) for an instant."""
    line_times_s: list[float]
    """(L,): times in the middle of the part."""
    seed: int


@dataclass(frozen=True)
class FrameExposure:
    """Poses and times of a frame's exposure."""

    parts: tuple[ExposurePart, ...]
    is_rolling: bool = False
    by_columns: bool = False
    """True if columns are read one after the other, not rows."""


class Film:
    """Mitsuba sensor with the division of frames into passes.

    An exposed film takes the samples of a pixel from many poses. No pass has more than `most_rows`.
    The rows of one `on_side` are the camera's columns. `samples_per_pixel` is the requested number,
    as rounded by the sampler.
    """

    def __init__(
        self,
        camera: Camera,
        settings: RenderSettings,
        samples: int,
        is_exposed: bool = False,
        most_rows: int | None = None,
        on_side: bool = False,
    ) -> None:
        family = str(mi.variant()).partition("_")[0]
        most = settings.samples_per_pass or SAMPLES_PER_PASS[family]
        height, width = camera.shape[::-1] if on_side else camera.shape
        if most_rows:
            most = min(most, width * samples * most_rows)
        self._on_side = on_side
        self._height = height
        self._rows, of_pass, self._repeats = plan_passes(width, height, samples, most)
        size = width, self._rows
        parts = film_and_sampler(size, settings.bands_nm, settings.sampler, of_pass)
        self._optics = self._sensor = mi.load_dict({**plugin(camera, on_side), **parts})
        if is_exposed:
            shutter = {"shutter_open": 0.0, "shutter_close": 1.0}
            self._sensor = mi.load_dict({"type": registered(Rows), **shutter, **parts})
            self._sensor.optics = self._optics
            self._sensor.lens = lens_of(self._optics)
        self._parameters = mi.traverse(self._optics)
        self._samples = int(self._sensor.sampler().sample_count())
        self.samples_per_pixel = self._samples * self._repeats

    def expose(
        self,
        trace: Callable[..., NDArray[np.float32]],
        scene: Any,
        poses: Floats,
        seed: int,
        before_rows: Callable[[slice], None] | None = None,
    ) -> NDArray[np.float32]:
        """Take a frame (H, W, n) from a pose (4, 4), or exposed from poses (times, lines, 4, 4).

        These have one line for all, or each. `trace` is `render` or `measured` of an integrator;
        `before_rows` is called with the rows of each pass.
        """
        strips: list[Floats] = []
        for first_row in range(0, self._height, self._rows):
            strip: Floats = np.zeros(())
            for repeat in range(self._repeats):
                if before_rows:
                    before_rows(slice(first_row, first_row + self._rows))
                self._aim(poses, first_row)
                number = len(strips) * self._repeats + repeat
                own_seed = part_seed(seed, "pass", number) if number else seed
                image = trace(scene, self._sensor, seed=own_seed, spp=self._samples)
                strip = strip + image.astype(np.float64)
            strips.append(strip / self._repeats)
        image = np.concatenate(strips)[: self._height].astype(np.float32)
        return np.ascontiguousarray(image.swapaxes(0, 1)) if self._on_side else image

    def _aim(self, poses: Floats, first_row: int) -> None:
        rows, height, is_exposed = self._rows, self._height, poses.ndim > 2
        # An exposed film looks through optics at Mitsuba's identity.
        to_world = np.eye(4) if is_exposed else sensor_transform(poses)
        self._parameters["to_world"] = mi.Transform4f(to_world.tolist())
        if "strip" in self._parameters:
            self._parameters["strip"] = mi.Point2f(first_row / height, rows / height)
        else:
            self._parameters["principal_point_offset_y"] = 0.5 - (height / 2 - first_row) / rows
        self._parameters.update()
        if is_exposed:
            # The last strip may extend beyond the frame.
            strip = np.minimum(np.arange(first_row, first_row + rows), poses.shape[1] - 1)
            self._sensor.move(sensor_transform(poses[:, strip] if poses.shape[1] > 1 else poses))


def film_and_sampler(
    size: tuple[int, int], bands_nm: Bands, sampler: str, samples: int
) -> dict[str, Any]:
    """Mitsuba film, of a width and height in px, and sampler."""
    film: dict[str, Any] = {
        "type": "specfilm",
        "width": size[0],
        "height": size[1],
        "component_format": "float32",
        # The only filter that is bit-reproducible in vectorized variants, and a pixel is a box.
        "rfilter": {"type": "box"},
    }
    for index, (lower, upper) in enumerate(bands_nm):
        film[f"band_{index:03d}"] = {
            "type": "regular",
            "wavelength_min": lower,
            "wavelength_max": upper,
            "values": ",".join([repr(1 / (upper - lower))] * 2),
        }
    return {"film": film, "sampler": {"type": sampler, "sample_count": samples}}


# Samples traced at once: their results are held until they are summed.
SAMPLES_AT_ONCE = 2**22

Look = Callable[[Any, Any, Any], list[Any]]
"""Quantities along rays, a list of floats each, given rays, the place from 0 to 1 of each sample
among those of its pixel, and the sampler, which has more random numbers for them."""
Radiance = Callable[[Any, Any], tuple[Any, Any]]
"""Spectral radiance along rays, given a sampler and these, and True for those with a hit."""


def developed(sensor: Any, seed: int, samples: int, radiance: Radiance) -> NDArray[np.float32]:
    """Image (H, W, B) of a sensor with a box filter, equal to the last bit to that of `mi.render`.

    Rays are computed before their radiance, so the compiled path tracer depends neither on the
    image's size nor on the sensor.
    """
    film, sampler = sensor.film(), sensor.sampler()
    width, height = (int(size) for size in film.crop_size())
    film.prepare([])
    sampler.set_samples_per_wavefront(samples)
    sampler.seed(seed, width * height * samples)
    pixel = dr.arange(mi.UInt, width * height * samples) // dr.opaque(mi.UInt, samples)
    corner = mi.Point2f(pixel % width, pixel // width)
    position = (corner + sampler.next_2d()) * mi.Point2f(1 / width, 1 / height)
    aperture = sampler.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    time = sampler.next_1d() if sensor.shutter_open_time() > 0 else mi.Float(0.0)
    rays, weight = sensor.sample_ray_differential(time, sampler.next_1d(), position, aperture)
    sampler.schedule_state()
    dr.eval(rays, weight)
    light, valid = radiance(sampler, rays)
    block = film.create_block()
    # from 4 samples of a pixel on, these are summed before they are written
    block.set_coalesce(block.coalesce() and samples >= 4)
    block.put(
        corner,
        film.prepare_sample(
            light * weight, rays.wavelengths, block.channel_count(),
            alpha=dr.select(valid, mi.Float(1), mi.Float(0)),
        ),
    )  # fmt: skip
    film.put_block(block)
    return np.array(film.develop(), np.float32)


def pixel_means(
    sensor: Any, sampler: Any, seed: int, look: Look, chosen: NDArray[np.integer] | None = None
) -> NDArray[np.float32]:
    """Means (H, W, n) over as many samples of each pixel as the sampler has.

    With chosen pixels (P,), counted row by row: (P, n).
    """
    width, height = (int(size) for size in sensor.film().crop_size())
    samples, pixels, table = int(sampler.sample_count()), width * height, None
    if chosen is not None:
        pixels, table = len(chosen), mi.UInt(chosen.astype(np.uint32))
    most = min(samples, max(1, SAMPLES_AT_ONCE // pixels))
    at_once = max(part for part in range(1, most + 1) if samples % part == 0)
    sampler.set_samples_per_wavefront(at_once)
    sampler.seed(seed, pixels * at_once)
    # As constants they would have the same code compiled for each image size.
    columns, per_pixel, in_all = (dr.opaque(mi.UInt, x) for x in (width, at_once, samples))
    size = mi.Point2f(columns, dr.opaque(mi.UInt, height))
    total: list[Any] = []
    for first in range(0, samples, at_once):
        lane = dr.arange(mi.UInt, pixels * at_once)
        number = lane // per_pixel
        pixel = number if table is None else dr.gather(mi.UInt, table, number)
        corner = mi.Point2f(pixel % columns, pixel // columns)
        index = lane - number * per_pixel + dr.opaque(mi.UInt, first)
        place = (mi.Float(index) + 0.5) / mi.Float(in_all)
        position = (corner + sampler.next_2d()) / size
        time = sampler.next_1d() if sensor.shutter_open_time() > 0 else mi.Float(0.0)
        aperture = mi.Point2f(0.5) if lens_of(sensor) is None else sampler.next_2d()
        ray, _ = sensor.sample_ray(time, 0.5, position, aperture)
        sampler.schedule_state()
        dr.eval(ray, place)  # so that what is looked at does not depend on the camera
        seen = look(ray, place, sampler)
        dr.eval(seen)  # otherwise rays would be traced again for each quantity
        means = [dr.block_sum(values, at_once) / samples for values in seen]
        total = [a + b for a, b in zip(total, means, strict=True)] if total else means
        sampler.advance()
        sampler.schedule_state()
        dr.eval(total)
    image = np.stack([np.array(values) for values in total], axis=-1)
    return image if table is not None else image.reshape(height, width, -1)
