"""Settings of `megalopta benchmark sequence`: methods, photons, and their pooling."""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

from pydantic import Field, model_validator

from megalopta.config.model import LightLevel, LightLevels
from megalopta.config.scene import ONCE
from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.flow.detectors.registry import VELOCITY_METHODS
from megalopta.flow.stimuli.photons import resize
from megalopta.scenes.levels import illuminance_of

Flux = Annotated[float, Field(gt=0)]
Frames = Annotated[int, Field(ge=1)]


class Pooling(NamedTuple):
    """Pixels along a side, and frames, that are added."""

    pixels: int
    frames: int

    def __str__(self) -> str:
        """Describe it as text."""
        return f"{self.pixels} × {self.pixels} px, {self.frames} frame{'s'[: self.frames > 1]}"

    def light(self, light: Floats) -> Floats:
        """Add the light (T, H, W) of neighbors; excess frames and pixels are cut."""
        count = len(light) // self.frames
        kept = light[: count * self.frames].reshape(count, self.frames, *light.shape[1:])
        return resize(kept.sum(axis=1), self.shape((light.shape[1], light.shape[2])), "area")

    def shape(self, shape: tuple[int, int]) -> tuple[int, int]:
        """Return the pixels (H, W) of pooled frames."""
        return max(1, shape[0] // self.pixels), max(1, shape[1] // self.pixels)

    def steps(self, frames: int) -> Iterator[slice]:
        """Yield, for each pair of pooled frames, the steps from the middle of one to the next."""
        middle = (self.frames - 1) // 2
        for first in range(middle, frames // self.frames * self.frames - self.frames, self.frames):
            yield slice(first, first + self.frames)


NO_POOLING = Pooling(1, 1)


class RankingSettings(Record, frozen=True):
    """Methods, photons and pooling."""

    methods: Annotated[tuple[str, ...], ONCE, Field(min_length=1)] = VELOCITY_METHODS
    """Methods that give velocities: names, `module:function`, or ONNX files."""
    fluxes: Annotated[tuple[Flux, ...], ONCE] = (1e3, 1e4, 1e5, 1e6, 1e7, 1e8)
    """Photons per frame, summed over all pixels."""
    light_levels: LightLevels = ()
    """Further light levels, by name or in lux; their photons per frame are added to fluxes."""
    exposure_s: Annotated[float, Field(gt=0, le=1000)] = 0.01
    """Exposure of a frame at these levels (s)."""
    repeats: Annotated[int, Field(ge=1)] = 2
    """Independent photon draws per sequence."""
    pixels_pooled: Annotated[tuple[Frames, ...], ONCE, Field(min_length=1)] = (1, 2)
    """Sides of the squares of pixels whose photons are added (px)."""
    frames_pooled: Annotated[tuple[Frames, ...], ONCE, Field(min_length=1)] = (1, 2)
    """Successive frames whose photons are added."""
    camera_pairs: Annotated[int, Field(ge=0)] = 3
    """Pairs of frames per sequence from which the camera's motion is estimated."""
    wide_field: Annotated[tuple[str, ...], ONCE] = ("EMD",)
    """Methods without velocities, ranked with the others by the camera's yaw rate."""
    seed: int = 0
    """Seed of the photons."""

    @property
    def finest(self) -> Pooling:
        """Pooling of the fewest pixels and frames."""
        return Pooling(min(self.pixels_pooled), min(self.frames_pooled))

    @property
    def poolings(self) -> list[Pooling]:
        """All poolings."""
        return [Pooling(p, f) for p in self.pixels_pooled for f in self.frames_pooled]

    @model_validator(mode="after")
    def _has_light(self) -> "RankingSettings":
        if not self.fluxes and not self.light_levels:
            raise ValueError("give fluxes, or light_levels")
        return self


def photons_at(per_lux_s: float, level: LightLevel, exposure_s: float) -> float:
    """Photons of a mean frame at a level, in the rendered color; four digits."""
    return float(f"{per_lux_s * illuminance_of(level) * exposure_s:.4g}")
