"""The camera to and fro along a line."""

from typing import Literal

import numpy as np

from megalopta.scenes.trajectories.base import Float64, Path, Vector, looking


class Shuttle(Path, frozen=True):
    """To and fro along a line, looking ahead along +x."""

    kind: Literal["shuttle"] = "shuttle"
    """Which path this is."""

    center_m: Vector = (0.0, 0.0, 1.5)
    """Middle of the line (m)."""

    reach_m: float = 0.5
    """Farthest from the middle (m)."""

    rate_hz: float = 1.0
    """Ways to and fro per second (Hz)."""

    def course(self, times_s: Float64) -> tuple[Float64, Float64]:
        """Positions (n, 3), m, and rotations (n, 3, 3), camera axes to world."""
        aside = self.reach_m * np.sin(2 * np.pi * self.rate_hz * times_s)
        places = np.asarray(self.center_m) + aside[:, np.newaxis] * np.array([0.0, 1.0, 0.0])
        ahead = np.broadcast_to([1.0, 0.0, 0.0], places.shape)
        return places, looking(ahead, (0, 0, 1))

    def __str__(self) -> str:
        """What the camera does."""
        return f"moves {self.reach_m:g} m to and fro, {self.rate_hz:g} times per second"
