"""Read a dataset's frames, a chunk at a time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import zarr
from numpy.typing import NDArray

from megalopta.config.model import Configuration
from megalopta.core.bounded import undamaged
from megalopta.dataset.picture_light import clean_flow, light_of
from megalopta.dataset.store import Dataset
from megalopta.render import read_radiance, read_truth

if TYPE_CHECKING:
    from megalopta.render import Truth

FRAMES_AT_ONCE = 16
"""Most frames in memory, in every stage."""
_kept: dict[tuple[Path, int, int, int], Any] = {}
"""Decoded files, by path, inode, time and bytes, the last read ones last"""


def frames_at_once(settings: Configuration) -> int:
    """Return the number of frames of a sequence in memory; fewer of large ones."""
    pixels = settings.camera.width * settings.camera.height
    return min(FRAMES_AT_ONCE, settings.trajectory.frames, max(1, 2**23 // pixels))  # px at once


def decoded(path: Path, read: Callable[[Path], Any]) -> Any:
    """Return what a reader makes of a file, which is decoded once by all stages of a process."""
    state = path.stat()
    key = path, state.st_ino, state.st_mtime_ns, state.st_size
    if key not in _kept:
        _kept[key] = read(path)
        while len(_kept) > 1 and sum(size for *_, size in _kept) > 2**27:  # bytes kept
            del _kept[next(iter(_kept))]
    return _kept[key]


def read_radiance_frames(dataset: Dataset) -> Iterator[tuple[int, NDArray[np.float32]]]:
    """Yield successive chunks: number of the first frame, and radiance (n, H, W, B).

    It is the radiance that sensors see, through the shutter.
    """
    frames, chunk = dataset.configuration.trajectory.frames, frames_at_once(dataset.configuration)
    for first in range(0, frames, chunk):
        indices = range(first, min(first + chunk, frames))
        yield first, np.stack([read_radiance_frame(dataset, index) for index in indices])


def write_frames(
    group: zarr.Group, name: str, first: int, values: NDArray[Any], frames: int, **described: Any
) -> None:
    """Write frames (n, ...) into an array of a group, from number `first` on.

    The first call creates the array: `frames` long, `FRAMES_AT_ONCE` per chunk, with further
    arguments of `zarr.Group.create_array`.
    """
    if name not in group:
        chunks = (min(FRAMES_AT_ONCE, frames), *values.shape[1:])
        shape = (frames, *values.shape[1:])
        group.create_array(name, shape=shape, chunks=chunks, dtype=values.dtype, **described)
    cast("zarr.Array[Any]", group[name])[first : first + len(values)] = values


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Motion of a frame to the next: the true one, or for pictures the flow by `clean_flow`.

    It is undefined for the last picture.
    """

    flow: NDArray[np.floating]
    """(H, W, 2), px, +x right and +y down; NaN where undefined"""
    hidden: NDArray[np.bool_]
    """(H, W): pixels hidden in the next frame; for pictures unknown, and none"""
    purity: NDArray[np.floating]
    """(H, W): share of a pixel that the flow is true for; for pictures unknown, and 1"""


def read_motion(dataset: Dataset, index: int) -> FrameMotion:
    """Return the motion of one frame that sensors see. Raises UserError."""
    if dataset.configuration.scene.has_truth:
        truth = read_truth_frame(dataset, index)
        return FrameMotion(truth.flow_forward, truth.occluded_forward, truth.footprint.purity)
    frames, shape = light_of(dataset).frames, dataset.configuration.camera.shape
    if index + 1 < dataset.configuration.trajectory.frames:
        flow = clean_flow(frames.at(index), frames.at(index + 1))
    else:
        flow = np.full((*shape, 2), np.nan)
    return FrameMotion(flow, np.zeros(shape, np.bool_), np.ones(shape))


def read_truth_frame(dataset: Dataset, index: int) -> "Truth":
    """Ground truth of one frame that sensors see. Raises UserError, for pictures always."""
    dataset.require_truth()
    path = dataset.exposed_truth(index)
    with undamaged(path, f"remove the file and run: {dataset.render_again}"):
        truth: Truth = decoded(path, read_truth)
        camera = dataset.configuration.camera
        if truth.depth.shape != (camera.height, camera.width):
            raise ValueError(f"{path} differs in image size from dataset.yaml")
    return truth


def read_radiance_frame(dataset: Dataset, index: int) -> NDArray[np.float32]:
    """Radiance (H, W, B) of one frame that sensors see. Raises UserError."""
    if not dataset.configuration.scene.has_truth:
        return light_of(dataset).at(index)
    path = dataset.exposed_radiance(index)
    with undamaged(path, f"remove the file and run: {dataset.render_again}"):
        radiance: NDArray[np.float32]
        radiance, bands = decoded(path, read_radiance)
        camera, expected = dataset.configuration.camera, dataset.configuration.render.bands_nm
        if bands != expected or radiance.shape[:2] != (camera.height, camera.width):
            raise ValueError(f"{path} differs in image size or bands from dataset.yaml")
    return radiance
