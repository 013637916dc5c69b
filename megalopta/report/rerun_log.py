"""Record a view for Rerun's viewer, over the timelines "time" and "frame".

A sequence has its camera and its visible points in the world: z is up, meters. Pictures are below
the camera and next to it, in the colors of page and film. Frames and pixels are limited to a file
of some tens of MB.
"""

import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from megalopta.core.files import atomic_write
from megalopta.core.progress import progress
from megalopta.report.images import evenly_spaced
from megalopta.report.seen import Panel, Seen

if TYPE_CHECKING:
    from megalopta.dataset.sequence import Sequence

_FRAMES = 60
_MOST_POINTS = 20_000
"""Most points of a frame"""
_WORLD, _CAMERA = ["world"], ["world", "camera"]

Place = list[str]
"""Names of nested entities; the SDK escapes what a path cannot hold"""


def write_rrd(path: Path, found: Seen) -> Path:
    """Write a view as .rrd; return its path.

    Raises ModuleNotFoundError if the Rerun SDK is not installed.
    """
    import rerun

    frames = evenly_spaced(found.frames, _FRAMES)
    with atomic_write(path) as temporary, rerun.RecordingStream("megalopta") as recording:
        recording.save(temporary)
        if found.sequence:
            recording.log(_WORLD, rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        with progress("Writing for Rerun", len(frames), "frame") as advance:
            for frame in frames:
                recording.set_time("frame", sequence=frame)
                if found.times_s is not None:
                    recording.set_time("time", duration=float(found.times_s[frame]))
                for place, entity in _entities(rerun, found, frame):
                    recording.log(place, entity)
                advance()
        recording.disconnect()
    return path


def _entities(rerun: Any, found: Seen, frame: int) -> Iterator[tuple[Place, Any]]:
    """Yield the entities of a frame with their places."""
    for panel in found.panels:
        yield _place(panel), _image(rerun, panel.picture(frame))
    if found.sequence:
        pose = found.sequence.poses[frame]
        yield _CAMERA, rerun.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])
        yield from _pinhole(rerun, found.sequence, found.step)
        if found.sequence.configuration.scene.has_truth:
            (panel,) = found.of("light")
            light = np.asarray(panel.picture(frame).convert("RGB"))
            yield [*_WORLD, "points"], _points(rerun, found.sequence, frame, found.step, light)


def _place(panel: Panel) -> Place:
    first = {"light": [*_CAMERA, "light"], "readings": ["readings"], "flow": ["found_flow"]}
    names = *first.get(panel.kind, [panel.name]), panel.sensor, panel.level
    return ["_".join(name.split()) for name in names if name]


def _image(rerun: Any, picture: Image.Image) -> Any:
    data = io.BytesIO()
    picture.convert("RGB").save(data, "PNG")
    return rerun.EncodedImage(contents=data.getvalue(), media_type="image/png")


def _pinhole(rerun: Any, sequence: "Sequence", step: int) -> Iterator[tuple[Place, Any]]:
    """Yield the pinhole of the shown pixels; nothing for a panorama."""
    if sequence.intrinsics is None:
        return
    matrix, (height, width) = sequence.intrinsics.copy(), sequence.shape
    matrix[:2] /= step
    yield (
        _CAMERA,
        rerun.Pinhole(
            image_from_camera=matrix,
            resolution=[math.ceil(width / step), math.ceil(height / step)],
            camera_xyz=rerun.ViewCoordinates.RDF,
        ),
    )


def _points(rerun: Any, sequence: "Sequence", frame: int, step: int, light: Any) -> Any:
    """Return the points that the pixels see, in the color of their light."""
    from megalopta.dataset.frames import read_truth_frame

    position = read_truth_frame(sequence.dataset, frame).position[::step, ::step].reshape(-1, 3)
    known = np.flatnonzero(np.isfinite(position).all(axis=-1))
    known = known[:: max(1, math.ceil(known.size / _MOST_POINTS))]
    return rerun.Points3D(position[known], colors=light.reshape(-1, 3)[known])
