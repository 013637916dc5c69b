"""How large a stage will be, before anything is built: what is absurd is refused with the figure.

Times and sizes are right to an order of magnitude, as the constants below are: measured on the demo
and the grating on two cores of a server, with LLVM.
"""

import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from megalopta.config.model import Configuration
from megalopta.core.errors import UserError
from megalopta.core.progress import duration, say
from megalopta.dataset.frames import FRAMES_AT_ONCE
from megalopta.flow.benchmark.settings import work_units
from megalopta.stages.sub_frames import burst_frames

LONGEST_S = 30 * 86400.0
"""Longer work is refused: it is a mistake, or too much for one machine."""
WORTH_TELLING_S, WORTH_TELLING_BYTES = 300.0, 1e9
"""From here on a line says what is to come."""

_SAMPLES_PER_S = 1e5
"""Light paths of a forest, all bounces included."""
_HAZE_WORK = 3.0
"""Times as much work a light path is in haze."""
_DIRECT_SAMPLES_PER_S = 1e6
"""Light paths of a scene that only glows, and points of a panorama."""
_FRAME_S = 0.1
"""Truth and files of a frame."""
_BUILD_S, _BUILD_S_PER_TREE, _POSE_S = 0.1, 0.03, 0.2
"""To bring a whole scene to another time, and boxes or balls alone."""
_POSES_OF_ROWS, _BUILDS_OF_TRUTH = 4, 3
"""Of a frame of a rolling shutter: poses that its rows share, and what its truth takes."""
_EXPOSED_PER_S, _DETECTED_PER_S, BENCHED_PER_S = 1e6, 3e6, 1e7
"""Pixels of a sensor, and pixels of a detector in the stages flow and benchmark."""
_MOVED_PER_S, _BITS_PER_S = 2e6, 5e7
"""Pixels of one step of moving light, and of binary frames."""
_SIMULATED_PER_S, _SIMULATED_BITS_PER_S = 3e5, 1e7
"""Pixels of frames, and of binary frames of a burst, whose avalanches are drawn one by one."""

_BAND_BYTES, _TRUTH_BYTES, _TRAINING_BYTES = 3.9, 72, 14
"""Per pixel on disk, compressed; rendering noise does not compress."""
_COUNTS_BYTES, _CORRECTED_BYTES, _RESPONSE_BYTES, _LIGHT_BYTES = 22, 7, 5, 8
"""Per pixel on disk: of an exposure, of its corrected readings, of a detector's responses to one,
and of the light that the benchmark keeps while it runs."""
_PROGRAM_BYTES, _RENDERED_BYTES, _POSE_BYTES = 1e9, 1000, 1000
"""In memory: the program, a pixel while it is rendered, a frame's pose."""
_EXPOSED_BYTES, _SEEN_BYTES, _DRAWN_BYTES = 120, 80, 60
"""In memory, of a pixel of a frame held: exposed on a sensor, seen by detectors, drawn in the
benchmark."""
_STATE_BYTES = 80
"""In memory, of a pixel: what a detector keeps from frame to frame."""


@dataclass(frozen=True)
class Estimate:
    """What one stage will take.

    Attributes
    ----------
    stage : str
        Its name.
    frames, width, height : int
        Of the sequence.
    samples : float
        Light paths, or pixels that sensors expose and detectors see.
    disk_bytes, memory_bytes, seconds : float
        On disk, at most in memory, and of work.
    """

    stage: str
    frames: int
    width: int
    height: int
    samples: float
    disk_bytes: float
    memory_bytes: float
    seconds: float

    def __str__(self) -> str:
        """One line for a person."""
        return (
            f"{self.stage}: {self.frames} frames of {self.width} × {self.height}, "
            f"about {size(self.disk_bytes)}, about {duration(self.seconds)}"
        )


def estimate(settings: Configuration, stage: str) -> Estimate:
    """Return what a stage of a configuration will take."""
    return _ESTIMATES[stage](settings)


def refuse_absurd(settings: Configuration, stage: str, root: Path) -> None:
    """Refuse a stage that exceeds this machine or a month, before anything is built.

    Raises
    ------
    UserError
        With what it would take, what there is, and the settings to lower.
    """
    foreseen = estimate(settings, stage)
    limits = (
        (foreseen.memory_bytes, _memory_bytes(), size, "of memory, and this machine has"),
        (foreseen.seconds, LONGEST_S, duration, "of work, more than the longest that is begun,"),
        (foreseen.disk_bytes, _room_bytes(root), size, f"on disk, and {root} has room for"),
    )
    for needed, most, told, clause in limits:
        if needed > most:
            raise UserError(
                f"{stage}: {foreseen.frames} frames of {foreseen.width} × {foreseen.height} would "
                f"take about {told(needed)} {clause} {told(most)}; lower {_REMEDIES[stage]}"
            )


def announce(settings: Configuration, stage: str) -> None:
    """Say what is to come where it is much."""
    foreseen = estimate(settings, stage)
    if foreseen.seconds > WORTH_TELLING_S or foreseen.disk_bytes > WORTH_TELLING_BYTES:
        say(str(foreseen))


def size(number: float) -> str:
    """An amount of memory for a person, such as "40 GB"."""
    for unit, bytes_ in (("PB", 1e15), ("TB", 1e12), ("GB", 1e9)):
        if number >= bytes_:
            return f"{number / bytes_:.3g} {unit}"
    return f"{number / 1e6:.0f} MB"


def _render(settings: Configuration) -> Estimate:
    frames, pixels = _frames_and_pixels(settings)
    shutter, bands = settings.shutter, len(settings.render.bands_nm)
    passes = settings.render.max_passes if settings.render.target_error else 1
    times = passes if shutter.is_instant else 2 * passes
    samples = float(frames * pixels * settings.render.samples_per_pixel * times)
    per_s = _SAMPLES_PER_S if settings.scene.has_bounces else _DIRECT_SAMPLES_PER_S
    work = samples * (_HAZE_WORK if settings.scene.is_hazy else 1)
    truths = 2 if shutter.readout_s else 1
    radiances = 1 if shutter.is_instant else 2
    per_pixel = bands * _BAND_BYTES * radiances + _TRUTH_BYTES * truths + _TRAINING_BYTES
    return _of(
        settings,
        "render",
        samples,
        disk_bytes=frames * pixels * per_pixel,
        memory_bytes=pixels * (_RENDERED_BYTES + 16 * bands) + frames * _POSE_BYTES,
        seconds=frames * (_FRAME_S * radiances + _moving_s(settings, passes)) + work / per_s,
    )


def _moving_s(settings: Configuration, passes: int) -> float:
    """Time to bring what moves to the times of a frame, of which each pass is taken anew."""
    scene, shutter = settings.scene, settings.shutter
    if not scene.is_moving and all(each.is_at_rest for each in settings.objects):
        return 0.0
    build = _BUILD_S + _BUILD_S_PER_TREE * scene.counts.get("trees", 0)
    # Truth builds what sways once more.
    sharp = 2 * build if scene.is_moving else build
    if shutter.is_instant:
        return sharp
    poses = shutter.poses if shutter.exposure_s else 1
    poses *= _POSES_OF_ROWS if shutter.readout_s else 1
    truth = _BUILDS_OF_TRUTH * build if shutter.readout_s and scene.is_moving else 0.0
    return sharp + passes * poses * (build if scene.is_moving else _POSE_S) + truth


def _sense(settings: Configuration) -> Estimate:
    frames, pixels = _frames_and_pixels(settings)
    exposed = float(frames * pixels * len(settings.sensors) * len(settings.light_levels))
    bits = exposed * burst_frames(settings) if "burst_npy" in settings.products else 0.0
    moved = exposed * settings.sub_frames * (2 if bits else 1) if settings.sub_frames > 1 else 0.0
    return _of(
        settings,
        "sense",
        exposed,
        disk_bytes=exposed * (_COUNTS_BYTES + _CORRECTED_BYTES * settings.correct) + bits / 8,
        memory_bytes=float(_held(frames) * pixels * (_EXPOSED_BYTES + 8 * settings.sub_frames)),
        seconds=exposed / _EXPOSED_PER_S
        + moved / _MOVED_PER_S
        + bits / _BITS_PER_S
        + settings.free_running * exposed * len(settings.products) / _SIMULATED_PER_S
        + settings.free_running * bits / _SIMULATED_BITS_PER_S,
    )


def _flow(settings: Configuration) -> Estimate:
    frames, pixels = _frames_and_pixels(settings)
    methods, exposures = len(settings.methods), len(settings.sensors) * len(settings.light_levels)
    seen = float(frames * pixels * exposures * methods)
    return _of(
        settings,
        "flow",
        seen,
        disk_bytes=seen * _RESPONSE_BYTES,
        memory_bytes=float(pixels * (_held(frames) * _SEEN_BYTES + 3 * methods * _STATE_BYTES)),
        seconds=seen / _DETECTED_PER_S,
    )


def _benchmark(settings: Configuration) -> Estimate:
    frames, pixels = _frames_and_pixels(settings)
    shape = frames, settings.camera.height, settings.camera.width
    times = len(settings.methods) * len(settings.benchmark.measurements)
    drawn = float(work_units(shape, settings.benchmark) * times)
    states = 2 * len(settings.methods) * len(settings.benchmark.fluxes)
    return _of(
        settings,
        "benchmark",
        drawn,
        disk_bytes=float(frames * pixels * _LIGHT_BYTES),
        memory_bytes=float(pixels * (_held(frames) * _DRAWN_BYTES + states * _STATE_BYTES)),
        seconds=drawn / BENCHED_PER_S,
    )


_ESTIMATES: Mapping[str, Callable[[Configuration], Estimate]] = {
    "render": _render,
    "sense": _sense,
    "flow": _flow,
    "benchmark": _benchmark,
}
_REMEDIES = {
    "render": "trajectory.frames, camera.width and height, or render.samples_per_pixel",
    "sense": "trajectory.frames, the camera's size, sub_frames or burst_hz, or give fewer sensors "
    "or light_levels",
    "flow": "trajectory.frames or the camera's size, or give fewer methods or exposures",
    "benchmark": "trajectory.frames, benchmark.fluxes_per_decade or repeats, or give fewer sizes",
}


def _frames_and_pixels(settings: Configuration) -> tuple[int, int]:
    return settings.trajectory.frames, settings.camera.width * settings.camera.height


def _held(frames: int) -> int:
    return min(frames, FRAMES_AT_ONCE)


def _of(
    settings: Configuration,
    stage: str,
    samples: float,
    *,
    disk_bytes: float,
    memory_bytes: float,
    seconds: float,
) -> Estimate:
    camera, frames = settings.camera, settings.trajectory.frames
    memory = _PROGRAM_BYTES + memory_bytes
    return Estimate(
        stage, frames, camera.width, camera.height, samples, disk_bytes, memory, seconds
    )


def _memory_bytes() -> float:
    """Physical memory of this machine."""
    return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


def _room_bytes(root: Path) -> float:
    """What is free at a folder, made or not, with what is in it: that may be part of the output."""
    there = next(
        folder for folder in (root.absolute(), *root.absolute().parents) if folder.exists()
    )
    held = sum(path.stat().st_size for path in root.rglob("*") if path.is_file())
    return float(shutil.disk_usage(there).free + held)
