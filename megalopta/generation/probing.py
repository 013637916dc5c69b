"""What a sequence takes, measured on two small frames of it.

A strip of each image is rendered and exposed: as wide as the image, so that its pixels are those of
the whole, and with as many rows as take a second or two. Times are then told by what they follow:
building by the expected triangles, radiance by the samples, all else by the pixels and frames.
Baked light that is asked for is baked for the strip; where `auto` may bake, paths are traced, and
the time told is the most that `auto` takes.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from megalopta.config.model import Configuration
from megalopta.core.progress import (
    Spent,
    silent,
    step,
    times_of_steps,
)
from megalopta.dataset.store import Dataset, files_in
from megalopta.render import MEASURED_EVERY
from megalopta.render.baking.choice import AT_EQUAL_ERROR, may_pay
from megalopta.stages.render import FrameWriter, build, write_previews

_FRAMES = 2
_MOST_PIXELS, _FEWEST_ROWS = 8192, 8
_PATHS, _DIRECT_PATHS, _BAKED_PIXELS = 60_000, 200_000, 256
"""In a strip: light paths of a scene with bounces and of one that glows, pixels that are baked"""
_CLOSING = 200_000
_ONCE = "counting the rays that baked light takes", "baking light"
_SETUP = "building the scene", "loading the scene"

Time = NDArray[np.float64]
"""Of a clock, and of processors (s), (2,)."""
Finish = Callable[[Dataset], None]
"""What follows the rendering of a dataset's frames, such as sensors."""


@dataclass(frozen=True)
class Scale:
    """What a sequence's cost goes by."""

    things: int
    """In the scene, such as trees; 0 where they are not counted."""
    triangles: float
    """Expected: of scenes of one kind in proportion, within a half."""
    pixels: int
    samples: float
    """Of a pass of a frame."""
    frames: int
    passes: int
    """Over all frames, those by which the error is measured included."""
    closing: int
    """Light paths that measure the light on the ground, the canopy and what is left out."""
    most: float
    """Times as long as paths take, at most, where `auto` bakes; 1 where it does not."""

    @classmethod
    def of(cls, settings: Configuration) -> "Scale":
        """That of a configuration."""
        camera, shutter = settings.camera, settings.shutter
        pixels = camera.width * camera.height
        passes = 1 if shutter.is_instant else 2
        samples = float(pixels * settings.render.samples_per_pixel * passes)
        things = sum(settings.scene.counts.values())
        way_m = np.diff(settings.trajectory.poses()[:, :3, 3], axis=0)
        triangles = settings.scene.expected_triangles(float(np.linalg.norm(way_m, axis=1).sum()))
        frames, shading = settings.trajectory.frames, settings.render
        measured = 0 if shading.target_error else math.ceil(frames / MEASURED_EVERY)
        baked = shading.integrator == "auto" and may_pay(shading, frames, pixels)
        closing = _CLOSING if settings.scene.is_lit_from_outside else 0
        most = AT_EQUAL_ERROR if baked else 1.0
        passes = frames + measured
        return cls(things, triangles, pixels, samples, frames, passes, closing, most)


@dataclass(frozen=True)
class Probe:
    """What a short piece of a sequence took."""

    scale: Scale
    setup: Time
    """Building and loading the scene; its plants are grown before if others share them."""
    compiling: Time
    """What the first frame takes beyond others; what it compiles is kept."""
    once: Time
    """Baking light."""
    radiance: Time
    """Of a pass of a frame."""
    rest: Time
    """Of a frame: truth, files, sensors."""
    fixed_bytes: float
    frame_bytes: float


@dataclass(frozen=True)
class Foreseen:
    """What sequences take: time (s) by the clock and of processors, and bytes on disk."""

    time: Time
    bytes: float
    most: bool
    """Whether it is the most that they take."""


def probe(settings: Configuration, things: int, finish: Finish, shares_plants: bool) -> Probe:
    """Measure two frames of a strip, of a scene with at most so many things, and what follows."""
    whole = _small(settings, things)
    path = whole.trajectory.model_copy(update={"frames": min(whole.trajectory.frames, _FRAMES)})
    short = whole.model_copy(update={"trajectory": path})
    with TemporaryDirectory(prefix="megalopta-probe-") as folder, silent():
        dataset = Dataset(Path(folder), short)
        if shares_plants:
            build(whole)
        with times_of_steps() as first:
            writer = FrameWriter(dataset, whole)
            writer.write(0)
        with times_of_steps() as steps:
            with step("frame"):
                writer.write(path.frames - 1)
            with step("files"):
                write_previews(dataset)
                finish(dataset)
        return _probe(dataset, first, steps)


def _probe(dataset: Dataset, first: Mapping[str, Spent], steps: Mapping[str, Spent]) -> Probe:
    """Put together what the first frame took, with all before it, and another that is warm."""
    scale, once = Scale.of(dataset.configuration), _time(first, *_ONCE)
    passes = 2 if scale.frames == 1 and scale.passes == 2 else 1
    radiance = _time(steps, "rendering radiance") / passes
    beyond = _time(first, "rendering radiance") - 2 * radiance
    rest = _time(steps, "frame") - passes * radiance + _time(steps, "files") / scale.frames
    fixed, of_frames = _bytes(dataset.root)
    return Probe(
        scale,
        setup=_time(first, *_SETUP) - once,
        compiling=np.maximum(beyond, 0),
        once=once,
        radiance=radiance,
        rest=rest,
        fixed_bytes=fixed,
        frame_bytes=of_frames / scale.frames,
    )


def foresee(scale: Scale, like: Probe, is_first: bool = True) -> Foreseen:
    """Return what a sequence takes, in proportion to a probe of its like.

    If it is the first of its like it compiles what measures the light on the ground, the canopy and
    what paths leave out, which takes as long as what the probe compiled of frames.
    """
    pixels = scale.pixels / like.scale.pixels
    samples = scale.most * scale.passes * scale.samples + scale.closing
    total = (
        like.setup * (scale.triangles / like.scale.triangles)
        + like.once * pixels
        + like.radiance * (samples / like.scale.samples)
        + like.rest * (scale.frames * pixels)
        + like.compiling * (is_first and scale.closing > 0)
    )
    bytes_ = like.fixed_bytes + scale.frames * pixels * like.frame_bytes
    return Foreseen(total, bytes_, scale.most > 1)


def _small(settings: Configuration, things: int) -> Configuration:
    """A strip of the whole sequence, of a scene with at most so many things."""
    scene, camera, shading = settings.scene, settings.camera, settings.render
    fewer = {
        name: min(count, things)
        for name, count in scene.counts.items()
        if name in type(scene).model_fields
    }
    if shading.integrator == "auto":
        shading = shading.model_copy(update={"integrator": "path"})
    rows = math.ceil(_pixels(settings) / camera.width)
    rows = min(max(rows, _FEWEST_ROWS), camera.height)
    return settings.model_copy(
        update={
            "scene": scene.model_copy(update=fewer),
            "camera": camera.model_copy(update={"height": rows}),
            "render": shading,
        }
    )


def _pixels(settings: Configuration) -> float:
    if settings.render.integrator == "baked":
        return _BAKED_PIXELS
    paths = _PATHS if settings.scene.has_bounces else _DIRECT_PATHS
    passes = settings.render.max_passes if settings.render.target_error else 1
    return min(_MOST_PIXELS, paths / (settings.render.samples_per_pixel * passes))


def _time(steps: Mapping[str, Spent], *names: str) -> Time:
    found = [steps[name] for name in names if name in steps]
    return np.array(
        [sum(each.seconds for each in found), sum(each.cpu_seconds for each in found)], float
    )


def _bytes(root: Path) -> tuple[float, float]:
    """Bytes of what a sequence has once, and of what grows with its frames."""
    sizes = {path: path.stat().st_size for path in files_in([root])}
    fixed = sum(size for path, size in sizes.items() if path.suffix == ".json")
    return float(fixed), float(sum(sizes.values()) - fixed)
