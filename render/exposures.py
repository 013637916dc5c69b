"""A frame as a shutter takes it: from which poses, and when."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.scenes import Shutter
from megalopta.scenes.trajectories.base import Path


@dataclass(frozen=True)
class Part:
    """A part of an exposure, in which moving objects stand still."""

    poses: Floats
    """(K, R, 4, 4): camera to world at K times, for all rows alike (R = 1) or for each (R = H);
    (4, 4) of an instant."""
    row_times_s: list[float]
    """(R,): in the middle of the part."""
    seed: int


@dataclass(frozen=True)
class Exposure:
    """A frame as a shutter takes it."""

    parts: tuple[Part, ...]
    is_rolling: bool = False

    @property
    def is_instant(self) -> bool:
        """Whether it is taken at once, from one pose."""
        return self.parts[0].poses.ndim == 2

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
