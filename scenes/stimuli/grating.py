"""Camera inside a cylinder whose wall glows with a pattern.

One frame of grating spans the horizontal field of view in azimuth, and as much up the wall. Columns
of a perspective image are not equidistant in azimuth: "f cycles per frame" is exceeded at its
center.
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from megalopta.assets_gen import generator, grating as patterns
from megalopta.core.arrays import Floats
from megalopta.scenes.base import SceneDescription, kind_of
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.light import Light
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat, luminous
from megalopta.scenes.trajectories.base import Path
from megalopta.scenes.trajectories.steady import Trajectory

if TYPE_CHECKING:
    import trimesh

_RADIUS_M = 10.0
_TEXELS = 4096
_STEEPEST_TANGENT = 4.0

PATTERN_NAMES: Mapping[patterns.Pattern, str] = {
    "sine_2d": "A 2-D sine grating",
    "sine": "A sine grating",
    "square": "A square-wave grating",
    "dots": "Random dots",
}
"""Patterns, as the beginning of a sentence."""


class Grating(SceneDescription, frozen=True):
    """Pattern on a cylinder around the camera: the 2-D sine grating, bars, or random dots."""

    kind: Literal["grating"] = "grating"
    pattern: patterns.Pattern = "sine_2d"
    """sine_2d: the grating of the flow benchmark; sine and square: vertical bars; dots: random
    disks of half a period's diameter that cover half of the wall."""
    contrast: Annotated[float, Field(ge=0, le=1)] = 0.9
    """Michelson contrast C."""
    cycles_per_frame: Annotated[float, Field(gt=0)] = 5.0
    """Spatial frequency f (cycles per horizontal field of view)."""
    phases_rad: tuple[float, float] = (0.0, 0.0)
    """Phases of the two factors of sine_2d; the first is that of bars (rad)."""
    variant: patterns.GratingVariant = "periodic"
    """Variant of sine_2d. rot: as in the dissertation, √2·f moving cycles; periodic: exactly f."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Random seed of the dots."""

    is_self_luminous = True

    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """Return the glowing cylinder around a camera that turns in place.

        Its mean luminance is that of a uniform sky of the light's illuminance.

        Raises ValueError if the moving part does not close around the cylinder, the camera cannot
        resolve it, or the trajectory looks past the wall.
        """
        position_m = _position_on_axis(trajectory)
        if camera.steepest_tangent > _STEEPEST_TANGENT:
            limit = math.floor(math.degrees(math.atan(_STEEPEST_TANGENT)))
            raise ValueError(
                f"the grating's cylinder ends {limit}° above and below the horizon and the "
                f"{camera.kind} camera looks past it: take a smaller field of view, in a panorama "
                f"camera.lower_deg -{limit} and camera.upper_deg {limit}"
            )
        cycles = patterns.moving_cycles(self.cycles_per_frame, self.variant, self.pattern)
        fov_deg = math.degrees(camera.view_rad)
        around = cycles * 360 / fov_deg
        # The pixel at the center spans the largest angle.
        most = camera.view_rad * camera.focal_length_px / 2
        if cycles > most:
            raise ValueError(
                f"scene.cycles_per_frame {self.cycles_per_frame:g}: {cycles:.3g} cycles over "
                f"{camera.width} columns are beyond half a cycle per pixel at the image center; "
                f"use at most {self.cycles_per_frame * most / cycles:.4g}"
            )
        if self.pattern != "dots" and abs(around - round(around)) > 1e-6:
            closing = self.cycles_per_frame * round(around) / around
            raise ValueError(
                f"scene.cycles_per_frame {self.cycles_per_frame:g} makes {around:.4g} cycles "
                f"around the cylinder at a field of view of {fov_deg:g}°, which does not close: "
                f"use {closing:.8g}"
            )
        half_height = 1.05 * camera.steepest_tangent
        pattern = _pattern(self, camera.view_rad, half_height)
        wall = patterns.open_cylinder(_RADIUS_M, 2 * half_height * _RADIUS_M)
        to_world = np.eye(4)
        to_world[:3, 3] = position_m
        return glowing("grating", wall, to_world, pattern, light)

    def describe(self) -> str:
        """Sentence for the report."""
        return (
            f"{PATTERN_NAMES[self.pattern]} of contrast {self.contrast:g}, "
            f"{self.cycles_per_frame:g} cycles across the frame, on a cylinder around the camera."
        )


def sky_radiance(illuminance_lux: float) -> float:
    """Radiance (W·m⁻²·sr⁻¹·nm⁻¹) of a uniform sky of flat spectrum and given illuminance."""
    return illuminance_lux / math.pi / luminous(flat(1.0))


def glowing(
    kind: str, mesh: "trimesh.Trimesh", to_world: Floats, pattern: Floats, light: Light
) -> Scene:
    """Scene of one mesh that glows like a sky of the light where its pattern is 1."""
    emission = Emission(sky_radiance(light.resolved().illuminance_lux), pattern.astype(np.float32))
    return Scene(
        materials={kind: Material(flat(0.0), None, emission)},
        assets={kind: Asset({kind: mesh})},
        placements=(Placement(kind, kind, to_world),),
    )


def _pattern(grating: Grating, fov: float, half_height: float) -> Floats:
    """Values 1 ± C on the unrolled wall, row 0 at its foot."""
    rows = math.ceil(_TEXELS * half_height / math.pi)  # as fine vertically as around
    columns = _TEXELS
    x = -(np.arange(columns) + 0.5) / columns * 2 * math.pi / fov
    y = ((np.arange(rows) + 0.5) / rows - 0.5) * 2 * half_height / fov
    cycles, contrast = grating.cycles_per_frame, grating.contrast
    if grating.pattern == "dots":
        size = (2 * half_height / fov * cycles, 2 * math.pi / fov * cycles)
        return patterns.random_dots(
            (rows, columns), size, contrast, generator(grating.seed, "dots")
        )
    if grating.pattern == "sine_2d":
        return patterns.sine_grating(
            x[None, :], y[:, None], contrast, cycles, grating.phases_rad, grating.variant
        )
    wave = patterns.bars(cycles * x, contrast, grating.phases_rad[0], grating.pattern == "square")
    return np.tile(wave, (4, 1))


def _position_on_axis(trajectory: Path) -> tuple[float, float, float]:
    if not isinstance(trajectory, Trajectory):
        kind = kind_of(type(trajectory))
        raise ValueError(
            f"trajectory.kind {kind!r}: a grating surrounds a camera that turns in "
            "place; use 'steady'"
        )
    height, past = trajectory.position_m[2], "the camera would look past the grating"
    if trajectory.look_at_m[2] != height:
        reason = f"look_at_m {trajectory.look_at_m} is not level with position_m, so {past}: give "
        raise ValueError(f"trajectory.{reason}it the height {height:g}")
    if any(trajectory.up[:2]) or trajectory.up[2] < 0:
        raise ValueError(f"trajectory.up {trajectory.up} is tilted, and {past}: use (0, 0, 1)")
    if any(trajectory.velocity_m_s):
        raise ValueError(
            f"trajectory.velocity_m_s {trajectory.velocity_m_s} takes the camera off the axis of "
            "the grating: use (0, 0, 0) and turn with rotation_deg_s"
        )
    return trajectory.position_m
