"""What `megalopta benchmark sequence` measures."""

from typing import Annotated

from pydantic import Field, field_validator

from megalopta.flow.benchmark import each_once
from megalopta.flow.detectors import METHODS, BlockDetector
from megalopta.ranking.pooling import Pooling
from megalopta.record import Record

Flux = Annotated[float, Field(gt=0)]
Frames = Annotated[int, Field(ge=1)]


class RankingSettings(Record, frozen=True):
    """Methods, photons and pooling."""

    methods: Annotated[tuple[str, ...], Field(min_length=1)] = tuple(
        name for name, each in METHODS.items() if isinstance(each, BlockDetector)
    )
    """Methods that give velocities."""

    fluxes: Annotated[tuple[Flux, ...], Field(min_length=1)] = (1e3, 1e4, 1e5, 1e6, 1e7, 1e8)
    """Photons per frame on all pixels (1)."""

    repeats: Annotated[int, Field(ge=1)] = 2
    """Independent draws of the photons of each sequence."""

    pixels_pooled: Annotated[tuple[Frames, ...], Field(min_length=1)] = (1, 2)
    """Sides of the squares of pixels whose photons are added (px)."""

    frames_pooled: Annotated[tuple[Frames, ...], Field(min_length=1)] = (1, 2)
    """Successive frames whose photons are added."""

    camera_pairs: Annotated[int, Field(ge=0)] = 3
    """Pairs of frames of each sequence from which the camera's motion is estimated."""

    seed: int = 0
    """Of the photons."""

    @property
    def finest(self) -> Pooling:
        """The least pooling."""
        return Pooling(min(self.pixels_pooled), min(self.frames_pooled))

    @field_validator("methods", "fluxes", "pixels_pooled", "frames_pooled")
    @classmethod
    def _each_once(cls, values: tuple[object, ...]) -> tuple[object, ...]:
        return each_once(values)

    @field_validator("methods")
    @classmethod
    def _with_velocities(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        able = [name for name, each in METHODS.items() if isinstance(each, BlockDetector)]
        for name in names:
            if name not in able:
                raise ValueError(
                    f"{name!r} is no method that gives velocities; choose from {', '.join(able)}"
                )
        return names
