"""Board with a pattern, square to the first view of a camera that moves in front of it.

Motion in the image has a closed form: a board at distance D shifts by f·s/D everywhere if the
camera, of focal length f (px), moves by s along it. The board covers all views.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from megalopta.assets_gen import generator
from megalopta.assets_gen.grating import (
    Pattern,
    bars,
    board,
    random_dots,
    sine_grating,
)
from megalopta.core.arrays import Floats
from megalopta.scenes.base import SceneDescription
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.lighting.light import Light
from megalopta.scenes.scene import Scene
from megalopta.scenes.stimuli.grating import PATTERN_NAMES, glowing
from megalopta.scenes.trajectories.base import Path

_TEXELS = 1024
_DOT_PERIODS = 32
"""Periods after which random dots repeat."""
_MARGIN = 0.02
"""Margin of the board beyond the visible part, relative to its size."""
_STEEPEST = 0.05
"""Smallest cosine between a ray and the board's normal."""


class Plane(SceneDescription, frozen=True):
    """Flat board with a pattern in front of the camera."""

    kind: Literal["plane"] = "plane"

    pattern: Pattern = "sine"
    """sine and square: vertical bars; sine_2d: the sum of vertical and horizontal bars; dots:
    random disks of half a period's diameter that cover half of the board."""

    contrast: Annotated[float, Field(ge=0, le=1)] = 0.9
    """Michelson contrast C."""

    period_m: Annotated[float, Field(gt=0)] = 0.5
    """Period of the pattern on the board (m)."""

    phase_rad: float = 0.0
    """Phase of bars at the center of the first view (rad)."""

    distance_m: Annotated[float, Field(gt=0)] = 2.0
    """Distance from the first camera position to the board, along the first view (m)."""

    seed: Annotated[int, Field(ge=0)] = 0
    """Random seed of the dots."""

    is_self_luminous = True
    has_bounces = False

    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """Return the glowing board; its mean luminance is that of a uniform sky of the light.

        Raises ValueError if a frame looks past the board, or the camera cannot resolve the pattern
        at first.
        """
        poses = trajectory.poses()
        pixel_m = self.distance_m / camera.focal_length_px
        if self.period_m < 2 * pixel_m:
            raise ValueError(
                f"scene.period_m {self.period_m:g} is less than two pixels at scene.distance_m "
                f"{self.distance_m:g}: use at least {2 * pixel_m:.4g}"
            )
        low, high = seen_rectangle(camera, poses, self.distance_m)
        tile_m = self.period_m * (_DOT_PERIODS if self.pattern == "dots" else 1)
        pose = board_pose(poses[0], self.distance_m)
        return glowing("plane", board(low, high, tile_m), pose, _tile(self), light)

    def describe(self) -> str:
        """Sentence for the report."""
        return (
            f"{PATTERN_NAMES[self.pattern]} of contrast {self.contrast:g} and period "
            f"{self.period_m:g} m on a board, {self.distance_m:g} m from the camera at first."
        )


def board_pose(first: Floats, distance_m: float) -> Floats:
    """Pose (4, 4) of a board square to a view at a distance; its axes are the camera's."""
    forward = np.eye(4)
    forward[2, 3] = distance_m
    return np.asarray(first @ forward)


def seen_rectangle(camera: Camera, poses: Floats, distance_m: float) -> tuple[Floats, Floats]:
    """Two corners (2,), in axes of the first camera (m), of the part of a board that the poses see.

    Raises ValueError if a ray of a frame misses the board, or meets it at a grazing angle.
    """
    to_first = np.linalg.inv(poses[0]) @ poses
    directions = camera.directions()
    rim = np.concatenate([directions[0], directions[-1], directions[:, 0], directions[:, -1]])
    rays = np.einsum("tij,nj->tni", to_first[:, :3, :3], rim)
    origins = to_first[:, None, :3, 3]
    ahead = distance_m - origins[..., 2]
    for frame in np.flatnonzero((ahead[:, 0] <= 0) | (rays[..., 2].min(axis=1) < _STEEPEST)):
        raise ValueError(
            f"trajectory: frame {frame} looks past the board at scene.distance_m {distance_m:g}; "
            "turn less, narrow the field of view, or move the board away"
        )
    points = origins[..., :2] + rays[..., :2] / rays[..., 2:] * ahead[..., None]
    low, high = points.min(axis=(0, 1)), points.max(axis=(0, 1))
    # A pixel extends half its width beyond its center, twice that where the board is oblique.
    margin = _MARGIN * (high - low) + 2 * distance_m / camera.focal_length_px
    return low - margin, high + margin


def _tile(plane: Plane) -> Floats:
    place = (np.arange(_TEXELS) + 0.5) / _TEXELS
    if plane.pattern == "dots":
        size = (_DOT_PERIODS, _DOT_PERIODS)
        rng = generator(plane.seed, "dots")
        return random_dots((_TEXELS, _TEXELS), size, plane.contrast, rng)
    if plane.pattern == "sine_2d":
        return sine_grating(place[None, :], place[:, None], plane.contrast, 1.0)
    wave = bars(place, plane.contrast, plane.phase_rad, plane.pattern == "square")
    return wave[None, :].repeat(2, axis=0)
