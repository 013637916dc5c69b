"""Motion bench of the dissertation's SPADCAM (§2.4.8): a plate crosses the beam over a row.

There a metal plate on a 3-D printer moves at 1 to 10 mm/s between a monochromator and the bare
array, 16 pixels of 60 µm in a row, read out 10 times a second: 1.67 to 16.7 pixels per frame.
Hidden pixels still receive stray light: 27 photons per pixel and frame against 65.

Here the camera replaces the array. Its rays meet the plate's plane one pixel pitch apart, and it
moves past the resting plate, which gives the same images: a camera velocity of 0.01 m/s to the
right is a plate that moves at 10 mm/s to the left. Its edges are sharp; the blur of the real ones
by the beam's divergence is not known. The true flow is that of the plate, and of the open beam as
if it moved along.
"""

from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from megalopta.assets_gen.grating import board
from megalopta.scenes.base import SceneDescription
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.lighting.light import Light
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat
from megalopta.scenes.stimuli.grating import sky_radiance
from megalopta.scenes.stimuli.plane import board_pose, seen_rectangle
from megalopta.scenes.trajectories.base import Path


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
    has_bounces = False

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
