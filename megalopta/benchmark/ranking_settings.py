"""What `megalopta benchmark sequence` measures."""

from typing import Annotated

from pydantic import Field, field_validator, model_validator

from megalopta.benchmark.methods import velocity_names
from megalopta.benchmark.pooling import Pooling
from megalopta.config.model import LightLevel
from megalopta.core.record import Record
from megalopta.flow.benchmark.settings import each_once
from megalopta.scenes.lighting.levels import illuminance_of

Flux = Annotated[float, Field(gt=0)]
Frames = Annotated[int, Field(ge=1)]


class RankingSettings(Record, frozen=True):
    """Methods, photons and pooling."""

    methods: Annotated[tuple[str, ...], Field(min_length=1)] = velocity_names()
    """Methods that give velocities: names, `module:function`, or ONNX files."""

    fluxes: tuple[Flux, ...] = (1e3, 1e4, 1e5, 1e6, 1e7, 1e8)
    """Photons per frame on all pixels (1)."""

    light_levels: tuple[LightLevel, ...] = ()
    """Light levels, by name or in lux, whose photons per frame are measured besides."""

    exposure_s: Annotated[float, Field(gt=0, le=1000)] = 0.01
    """Exposure of a frame at these levels (s)."""

    repeats: Annotated[int, Field(ge=1)] = 2
    """Independent draws of the photons of each sequence."""

    pixels_pooled: Annotated[tuple[Frames, ...], Field(min_length=1)] = (1, 2)
    """Sides of the squares of pixels whose photons are added (px)."""

    frames_pooled: Annotated[tuple[Frames, ...], Field(min_length=1)] = (1, 2)
    """Successive frames whose photons are added."""

    camera_pairs: Annotated[int, Field(ge=0)] = 3
    """Pairs of frames of each sequence from which the camera's motion is estimated."""

    wide_field: tuple[str, ...] = ("EMD",)
    """Methods without velocities that are judged, with the others, by the camera's yaw rate."""

    seed: int = 0
    """Of the photons."""

    @property
    def finest(self) -> Pooling:
        """The least pooling."""
        return Pooling(min(self.pixels_pooled), min(self.frames_pooled))

    @field_validator("methods", "fluxes", "pixels_pooled", "frames_pooled", "wide_field")
    @classmethod
    def _each_once(cls, values: tuple[object, ...]) -> tuple[object, ...]:
        return each_once(values)

    @field_validator("light_levels")
    @classmethod
    def _levels_are_known(cls, levels: tuple[LightLevel, ...]) -> tuple[LightLevel, ...]:
        for level in levels:
            illuminance_of(level)
        return each_once(levels)

    @model_validator(mode="after")
    def _has_light(self) -> "RankingSettings":
        if not self.fluxes and not self.light_levels:
            raise ValueError("give fluxes, or light_levels")
        return self
