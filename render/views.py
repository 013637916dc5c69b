"""What a scene's renderer asks of a camera before surfaces or before a panorama."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render.noise import MeasuredPass
from megalopta.render.surveys import LightSurvey
from megalopta.scenes import Shutter
from megalopta.scenes.trajectories.base import Path


@dataclass(frozen=True)
class Part:
    """A part of an exposure, in which moving objects stand still."""

    poses: Floats
    """(K, R, 4, 4): camera to world at K times, for all rows alike (R = 1) or for each (R = H)."""
    row_times_s: list[float]
    """(R,): in the middle of the part."""
    seed: int


@dataclass(frozen=True)
class Exposure:
    """A frame as a shutter takes it."""

    parts: tuple[Part, ...]
    is_rolling: bool

    @classmethod
    def of(
        cls,
        path: Path,
        shutter: Shutter,
        frame: int,
        rows: Floats,
        seeds: Sequence[int],
        count: int,
    ) -> "Exposure":
        """Frame of a camera's path from delays of its rows (R,), s: a part of `count` poses a seed.

        Poses are in the world.
        """
        parts = len(seeds)
        middles = (np.arange(parts * count) + 0.5) / (parts * count) - 0.5
        times = path.times_s[frame] + shutter.exposure_s * middles[:, None] + rows
        poses = path.pose_at(times.ravel()).reshape(parts, count, len(rows), 4, 4)
        instants = times.reshape(parts, count, len(rows)).mean(axis=1).tolist()
        return cls(tuple(map(Part, poses, instants, seeds)), shutter.readout_s > 0)

    def relative_to(self, local: Callable[[Floats], Floats]) -> "Exposure":
        """With poses (..., 4, 4) taken to others."""
        parts = tuple(replace(part, poses=local(part.poses)) for part in self.parts)
        return replace(self, parts=parts)


class View(Protocol):
    """A camera before what it sees; poses are relative to the scene's origin."""

    @property
    def samples_per_pixel(self) -> int:
        """Light paths, or points looked up, per pixel."""

    def move_to(self, time_s: float) -> None:
        """Put moving objects where they are at a time."""

    def radiance(self, pose: Floats, seed: int) -> NDArray[np.float32]:
        """Radiance (H, W, B) from a pose (4, 4)."""

    def measured(self, pose: Floats, seed: int) -> MeasuredPass:
        """The same, with what its error is known by."""

    def exposed(self, exposure: Exposure) -> NDArray[np.float32]:
        """Radiance (H, W, B) as a shutter takes it."""

    def exposed_measured(self, exposure: Exposure) -> MeasuredPass:
        """The same, with what its error is known by."""

    def light_left_out(self, pose: Floats) -> Floats | None:
        """Share of the light of surfaces, by band, that takes too many hits; None without any."""

    def light_survey(self, positions: Floats) -> LightSurvey | None:
        """Illuminance above and below camera positions (N, 3) in the world, if light has any."""
