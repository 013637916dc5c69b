"""Reading a dataset's frames, a chunk at a time."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

import numpy as np
import zarr
from numpy.typing import NDArray

from megalopta.core.errors import UserError
from megalopta.dataset.store import Dataset
from megalopta.render import read_radiance, read_truth
from megalopta.render.truth.tracer import Truth

FRAMES_AT_ONCE = 16
"""So many are in memory, in every stage."""


def read_radiance_frames(
    dataset: Dataset, chunk: int = FRAMES_AT_ONCE
) -> Iterator[tuple[int, NDArray[np.float32]]]:
    """Yield the first frame's number and radiance (n ≤ chunk, H, W, B) of successive chunks.

    It is the radiance that sensors see, through the shutter.
    """
    frames = dataset.configuration.trajectory.frames
    for first in range(0, frames, chunk):
        indices = range(first, min(first + chunk, frames))
        yield first, np.stack([read_radiance_frame(dataset, index) for index in indices])


def write_frames(
    group: zarr.Group, name: str, first: int, values: NDArray[Any], frames: int, **described: Any
) -> None:
    """Write frames (n, ...) into an array of a group, from a number on.

    The array is created with the first of them: `frames` long, `FRAMES_AT_ONCE` to a chunk, and
    described by what else `zarr.Group.create_array` takes.
    """
    if name not in group:
        chunks = (min(FRAMES_AT_ONCE, frames), *values.shape[1:])
        shape = (frames, *values.shape[1:])
        group.create_array(name, shape=shape, chunks=chunks, dtype=values.dtype, **described)
    cast("zarr.Array[Any]", group[name])[first : first + len(values)] = values


def read_truth_frames(dataset: Dataset) -> Iterator[Truth]:
    """Yield the ground truth of every frame that sensors see."""
    for index in range(dataset.configuration.trajectory.frames):
        yield read_truth_frame(dataset, index)


def read_truth_frame(dataset: Dataset, index: int) -> Truth:
    """Ground truth of one frame that sensors see. Raises UserError."""
    path = dataset.exposed_truth(index)
    with _remedy(dataset):
        truth = read_truth(path)
        camera = dataset.configuration.camera
        if truth.depth.shape != (camera.height, camera.width):
            raise ValueError(f"{path} has not the image size that dataset.yaml says")
    return truth


def read_radiance_frame(dataset: Dataset, index: int) -> NDArray[np.float32]:
    """Radiance (H, W, B) of one frame that sensors see. Raises UserError."""
    path = dataset.exposed_radiance(index)
    with _remedy(dataset):
        radiance, bands = read_radiance(path)
        camera, expected = dataset.configuration.camera, dataset.configuration.render.bands_nm
        if bands != expected or radiance.shape[:2] != (camera.height, camera.width):
            raise ValueError(f"{path} has not the image size or bands that dataset.yaml says")
    return radiance


@contextmanager
def _remedy(dataset: Dataset) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as problem:
        again = f"megalopta render {dataset.home} --out {dataset.home}"
        raise UserError(f"{problem}; remove the file and run: {again}") from None
