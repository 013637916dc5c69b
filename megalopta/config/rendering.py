"""Rendering of a scene: shutter, samples, label maps and tracks."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from megalopta.config.scene import ONCE, SceneSettings
from megalopta.core.record import Record
from megalopta.render import RenderSettings
from megalopta.scenes import Camera, Shutter
from megalopta.scenes.spectra.spectrum import check_known

LabelName = Literal["classes", "instances", "clusters", "normals", "albedo"]
_MOST_POINTS = 10**8
"""Most places of followed points in a sequence, 0.9 GB"""


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


class RenderingSettings(SceneSettings, frozen=True):
    """Rendering of a scene."""

    shutter: Shutter = Shutter()
    """Motion blur and rolling shutter of the sensors' frames."""
    render: RenderSettings = Field(RenderSettings(), validate_default=True)
    """Samples, depth, bands and backend."""
    labels: Annotated[tuple[LabelName, ...], ONCE] = Field(
        default=(), exclude_if=lambda labels: not labels
    )
    """Label maps that `render` writes for other programs: `classes`, `instances`, `clusters` of
    leaves, `normals`, `albedo`; default: none."""
    tracks: TrackSettings | None = Field(default=None, exclude_if=lambda tracks: tracks is None)
    """Points that `render` follows through all frames; default: none."""

    @field_validator("render")
    @classmethod
    def _depth_suits_the_scene(
        cls, render: RenderSettings, validation: ValidationInfo
    ) -> RenderSettings:
        scene = validation.data.get("scene")
        if scene is None or "max_depth" in render.model_fields_set:
            return render
        return render.model_copy(update={"max_depth": scene.max_depth})

    @model_validator(mode="after")
    def _rendering_suits_the_scene(self) -> "RenderingSettings":
        if self.scene.has_truth:  # pictures may hold spectra of their own
            white, name = self.scene.white(self.light), f"light {self.light.level!r}"
            check_known(name, white.range_nm, self.render.bands_nm, "")
        if self.render.integrator == "baked" and self.scene.is_hazy:
            raise ValueError(
                "render.integrator 'baked': baked light has no haze; use 'auto' or 'path', or "
                "omit scene.haze"
            )
        rate_hz = self.trajectory.frame_rate_hz
        for name in ("exposure_s", "readout_s"):
            if getattr(self.shutter, name) > (1 + 1e-9) / rate_hz:
                raise ValueError(
                    f"shutter.{name} {getattr(self.shutter, name):g} is longer than a frame at "
                    f"trajectory.frame_rate_hz {rate_hz:g}; use at most {1 / rate_hz:g}"
                )
        if not self.tracks:
            return self
        frames, last = self.trajectory.frames, max(self.tracks.frames)
        if last >= frames:
            raise ValueError(f"tracks.frames {last}: the sequence has frames 0 to {frames - 1}")
        points = len(self.tracks.frames) * len(self.tracks.points(self.camera)) * frames
        if points > _MOST_POINTS:
            raise ValueError(
                f"tracks.spacing_px {self.tracks.spacing_px}: {points:.2g} places of points in "
                f"all frames; use a larger spacing, with at most {_MOST_POINTS:.0e}"
            )
        return self
