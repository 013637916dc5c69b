"""A checkerboard: the plane with another name, to look at."""

from typing import Literal

from megalopta.scenes.stimuli.plane import Plane


class Checkerboard(Plane, frozen=True):
    """A board in front of the camera."""

    kind: Literal["checkerboard"] = "checkerboard"  # type: ignore[assignment]
    """Which scene this is."""
