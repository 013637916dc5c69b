"""Pooling of photons over pixels and frames, and the true motion that belongs to it."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from megalopta.core.arrays import Floats
from megalopta.flow.stimuli.resizing import resize


class Pooling(NamedTuple):
    """How many pixels along a side, and how many frames, are added."""

    pixels: int
    frames: int

    def __str__(self) -> str:
        """Say it in words."""
        return f"{self.pixels} × {self.pixels} px, {self.frames} frame{'s'[: self.frames > 1]}"

    def record(self, flux: float) -> dict[str, Any]:
        """Return it and a number of photons by name."""
        return {**self._asdict(), "photons_per_frame": flux}

    def light(self, light: Floats) -> Floats:
        """Add the light (T, H, W) of neighbors; frames and pixels that are left over are cut."""
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
