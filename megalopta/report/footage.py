"""The part of a sequence that the report shows: few enough frames and pixels for a small file.

Frames are spread evenly, pixels are taken, not averaged, so that noise looks as strong as it is.
The last frame is left out: it has no successor and so no true flow.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.config.model import Configuration
from megalopta.dataset.frames import read_radiance_frame, read_truth_frame
from megalopta.dataset.store import Dataset
from megalopta.render.truth.tracer import Truth
from megalopta.scenes import ToneCurve, preview, white_of
from megalopta.scenes.spectra.color import linear_srgb

_LONGEST_SIDE_PX = 160
_MOST_FRAMES = 40
_MOST_PIXELS_READ = 4_000_000
_MOST_PIXELS_SHOWN = 8_000_000
_OTHER_FILMS = 6


@dataclass(frozen=True)
class Selection:
    """Frames, by their numbers from 0, and pixels that are shown: every so many-th of a line."""

    frames: tuple[int, ...]
    step: int

    def pixels(self, images: NDArray[Any]) -> NDArray[Any]:
        """Return the shown pixels of images (..., H, W)."""
        return images[..., :: self.step, :: self.step]


@dataclass(frozen=True, eq=False)
class ReportFrames:
    """Radiance (n, H, W, B), preview images and ground truth of the selected frames.

    All are of the frames that sensors see, through the shutter.
    """

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


def read_footage(dataset: Dataset) -> ReportFrames:
    """Read what is shown. Raises UserError when a file cannot be read."""
    settings = dataset.configuration
    selection, bands = select(settings), settings.render.bands_nm
    radiance = [read_radiance_frame(dataset, index) for index in selection.frames]
    white = white_of(settings.scene, settings.light)
    curve = ToneCurve.of(linear_srgb(each, bands, white) for each in radiance)
    return ReportFrames(
        selection,
        np.stack(radiance),
        tuple(preview(each, bands, white, curve) for each in radiance),
        tuple(read_truth_frame(dataset, index) for index in selection.frames),
    )
