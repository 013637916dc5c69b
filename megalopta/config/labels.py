"""Settings of label maps and point tracks, which `render` writes."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.core.record import Record
from megalopta.scenes import Camera

LabelName = Literal["classes", "instances", "normals", "albedo"]


class TrackSettings(Record, frozen=True):
    """Points to follow through all frames: a grid of pixel centers of some frames."""

    spacing_px: Annotated[int, Field(ge=1)] = 8
    """Distance between neighboring points (px)."""

    frames: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)] = (0,)
    """Frames, from 0, in which the points are seen."""

    def points(self, camera: Camera) -> NDArray[np.float64]:
        """Image coordinates (N, 2) of the points, px, row by row."""
        first, step = self.spacing_px // 2, self.spacing_px
        return camera.pixel_centers()[first::step, first::step].reshape(-1, 2)
