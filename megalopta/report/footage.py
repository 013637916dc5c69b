"""What of a sequence the report shows: so many frames and pixels that the file stays small.

Frames are spread evenly, pixels are taken, not averaged, so that noise looks as strong as it is.
The last frame is left out: it has no successor and so no true flow.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from megalopta.configuration import Configuration
from megalopta.dataset import Dataset
from megalopta.errors import UserError
from megalopta.render.exr import read_radiance, read_truth
from megalopta.render.truth import Truth

Content = TypeVar("Content")

_LONGEST_SIDE_PX = 160
_MOST_FRAMES = 40
_MOST_PIXELS_READ = 4_000_000
_MOST_PIXELS_SHOWN = 8_000_000
_OTHER_FILMS = 6


@dataclass(frozen=True)
class Selection:
    """Frames and pixels that are shown.

    Attributes
    ----------
    frames : tuple of int
        Numbers of the frames, from 0.
    step : int
        Every so many-th pixel of a row and of a column is shown.
    """

    frames: tuple[int, ...]
    step: int

    def pixels(self, images: NDArray[Any]) -> NDArray[Any]:
        """Return the shown pixels of images (..., H, W)."""
        return images[..., :: self.step, :: self.step]


@dataclass(frozen=True, eq=False)
class Footage:
    """Radiance (n, H, W, B), preview images and ground truth of the selected frames."""

    selection: Selection
    radiance: NDArray[np.float32]
    previews: tuple[NDArray[np.uint8], ...]
    truths: tuple[Truth, ...]


def select(configuration: Configuration) -> Selection:
    """Choose what is shown of a sequence."""
    height, width = configuration.camera.height, configuration.camera.width
    step = math.ceil(max(height, width) / _LONGEST_SIDE_PX)
    films = len(configuration.sensors) * len(configuration.light_levels) + _OTHER_FILMS
    most = min(
        _MOST_FRAMES,
        _MOST_PIXELS_READ // (height * width),
        _MOST_PIXELS_SHOWN * step**2 // (height * width * films),
    )
    candidates = configuration.trajectory.frames - 1
    count = min(candidates, max(most, 1))
    return Selection(tuple(index * candidates // count for index in range(count)), step)


def read_footage(dataset: Dataset) -> Footage:
    """Read what is shown. Raises UserError when a file cannot be read."""
    selection = select(dataset.configuration)
    frames = selection.frames
    return Footage(
        selection,
        np.stack([_read(read_radiance, dataset.radiance(index))[0] for index in frames]),
        tuple(_read(_read_png, _preview(dataset, index)) for index in frames),
        tuple(_read(read_truth, dataset.truth(index)) for index in frames),
    )


def _preview(dataset: Dataset, index: int) -> Path:
    return dataset.frame("training/clean", index, "png")


def _read(reader: Callable[[Path], Content], path: Path) -> Content:
    try:
        return reader(path)
    except (OSError, ValueError) as problem:
        raise UserError(f"{problem}; render it again with --redo") from None


def _read_png(path: Path) -> NDArray[np.uint8]:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))
