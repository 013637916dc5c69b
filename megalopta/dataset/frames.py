"""Reading a dataset's frames, a chunk at a time."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from megalopta.dataset.store import Dataset
from megalopta.errors import UserError
from megalopta.render import read_radiance, read_truth
from megalopta.render.truth import Truth

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


def read_truth_frames(dataset: Dataset) -> Iterator[Truth]:
    """Yield the ground truth of every frame that sensors see."""
    for index in range(dataset.configuration.trajectory.frames):
        yield read_truth_frame(dataset, index)


def read_truth_frame(dataset: Dataset, index: int) -> Truth:
    """Ground truth of one frame that sensors see. Raises UserError."""
    try:
        truth = read_truth(dataset.exposed_truth(index))
    except (OSError, ValueError) as problem:
        raise UserError(f"{problem}; {_remedy(dataset)}") from None
    camera = dataset.configuration.camera
    if truth.depth.shape != (camera.height, camera.width):
        raise UserError(
            f"{dataset.exposed_truth(index)} has not the image size that dataset.yaml says; "
            f"{_remedy(dataset)}"
        )
    return truth


def read_radiance_frame(dataset: Dataset, index: int) -> NDArray[np.float32]:
    """Radiance (H, W, B) of one frame that sensors see. Raises UserError."""
    try:
        radiance, bands = read_radiance(dataset.exposed_radiance(index))
    except (OSError, ValueError) as problem:
        raise UserError(f"{problem}; {_remedy(dataset)}") from None
    camera = dataset.configuration.camera
    expected = dataset.configuration.render.bands_nm
    if bands != expected or radiance.shape[:2] != (camera.height, camera.width):
        raise UserError(
            f"{dataset.exposed_radiance(index)} has not the image size or bands that dataset.yaml "
            f"says; {_remedy(dataset)}"
        )
    return radiance


def _remedy(dataset: Dataset) -> str:
    return f"remove the file and run: megalopta render {dataset.home} --out {dataset.home}"
