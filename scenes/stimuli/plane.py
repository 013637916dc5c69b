"""Board with a pattern, square to the first view: at distance D it shifts by f·s/D px (s: the way).

On the motion bench of the dissertation's SPADCAM (§2.4.8) a plate crosses the beam over a row of 16
pixels of 60 µm at 1 to 10 mm/s, read out 10 times a second. Hidden pixels receive stray light: 27
photons per pixel and frame against 65. Here the camera replaces the array. Its rays meet the
plate's plane one pixel pitch apart, and it moves past the resting plate: a velocity of 0.01 m/s to
the right is a plate that moves at 10 mm/s to the left. Edges are sharp: the blur by the beam's
divergence is not known. The true flow is that of the plate, and of the beam as if it moved along.
"""

from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from megalopta.assets_gen import generator
from megalopta.assets_gen.grating import Pattern, bars, board, random_dots, sine_grating
from megalopta.core.arrays import Floats
from megalopta.scenes.base import SceneDescription
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.light import Light
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat
from megalopta.scenes.stimuli.grating import PATTERN_NAMES, glowing, sky_radiance
from megalopta.scenes.trajectories.base import Path

_TEXELS = 1024
_DOT_PERIODS = 32
"""Periods after which random dots repeat."""


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
        place = (np.arange(_TEXELS) + 0.5) / _TEXELS
        if self.pattern == "dots":
            size, rng = (_DOT_PERIODS, _DOT_PERIODS), generator(self.seed, "dots")
            tile = random_dots((_TEXELS, _TEXELS), size, self.contrast, rng)
        elif self.pattern == "sine_2d":
            tile = sine_grating(place[None, :], place[:, None], self.contrast, 1.0)
        else:
            wave = bars(place, self.contrast, self.phase_rad, self.pattern == "square")
            tile = wave[None, :].repeat(2, axis=0)
        pose = board_pose(poses[0], self.distance_m)
        return glowing("plane", board(low, high, tile_m), pose, tile, light)

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
    for frame in np.flatnonzero((ahead[:, 0] <= 0) | (rays[..., 2].min(axis=1) < 0.05)):  # cos 87°
        raise ValueError(
            f"trajectory: frame {frame} looks past the board at scene.distance_m {distance_m:g}; "
            "turn less, narrow the field of view, or move the board away"
        )
    points = origins[..., :2] + rays[..., :2] / rays[..., 2:] * ahead[..., None]
    low, high = points.min(axis=(0, 1)), points.max(axis=(0, 1))
    # A pixel extends half its width beyond its center, twice that where the board is oblique.
    margin = 0.02 * (high - low) + 2 * distance_m / camera.focal_length_px
    radius, focus = camera.lens_m or (0.0, 1.0)
    margin += radius * (1 + ahead.max() / focus)
    return low - margin, high + margin


class MotionBench(SceneDescription, frozen=True):
    """Plate with straight edges that the sensor moves past."""

    kind: Literal["motion_bench"] = "motion_bench"
    pixel_pitch_um: Annotated[float, Field(gt=0)] = 60.0
    """Distance between pixels, measured on the plate (µm)."""
    plate_mm: Annotated[float, Field(gt=0)] = 10.0
    """Width of the plate along the row (mm)."""
    edge_mm: float = 1.0
    """Position of its near edge at the first frame, to the right of the row's middle (mm)."""
    shade: Annotated[float, Field(ge=0, le=1)] = 27 / 65
    """Light on a hidden pixel, relative to an open one (1)."""

    is_self_luminous = True

    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """Return the plate before the beam; open pixels see a sky of the light's illuminance.

        Raises ValueError if the camera turns so far that it looks past the plate's plane.
        """
        poses = trajectory.poses()
        distance_m = self.pixel_pitch_um * 1e-6 * camera.focal_length_px
        low, high = seen_rectangle(camera, poses, distance_m)
        edges = 1e-3 * np.array([self.edge_mm, self.edge_mm + self.plate_mm])
        limits = np.concatenate([[low[0]], np.clip(edges, low[0], high[0]), [high[0]]])
        pose = board_pose(poses[0], distance_m)
        radiance = sky_radiance(light.resolved().illuminance_lux)
        glow = {"beam": radiance, "plate": radiance * self.shade}
        assets, placements = {}, []
        parts = (("beam 1", "beam"), ("plate", "plate"), ("beam 2", "beam"))
        for (name, kind), (left, right) in zip(parts, pairwise(limits), strict=True):
            if left < right:
                corner, opposite = np.array([[left, low[1]], [right, high[1]]])
                assets[name] = Asset({kind: board(corner, opposite, 1.0)})
                placements.append(Placement(name, kind, pose))
        materials = {
            kind: Material(flat(0.0), None, Emission(glow[kind]))
            for kind in sorted({placement.kind for placement in placements})
        }
        return Scene(materials, assets, tuple(placements))

    def describe(self) -> str:
        """Sentence for the report."""
        return (
            f"A plate, {self.plate_mm:g} mm wide, that lets {100 * self.shade:.0f} % of the light "
            f"through, over pixels {self.pixel_pitch_um:g} µm apart."
        )
