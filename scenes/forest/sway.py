"""Trees swaying in the wind: bending grows with the square of the height.

A point at height z of a tree of height h is displaced sideways by (z/h)²·d(t), its height stays.
That is the first mode of a cantilever to a few percent, if the top moves little compared with the
height. d(t) is an ellipse: along the wind d_a·sin(ωt + φ), across it less, at a frequency slightly
off. The frequency falls with the height as observed on conifers (Moore and Maguire, Trees 18, 2004,
give 0.1 Hz + 3.4 Hz·D/h² with the diameter D in cm and h in m; with D growing as h that is nearly
1/h).
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from megalopta.assets_gen import generator
from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.scenes.scene import Asset, Placement

FREQUENCY_TIMES_HEIGHT = 6.0
"""Frequency of a tree times its height (Hz·m): 0.3 Hz at 20 m."""
FREQUENCY_SPREAD = 0.15
"""Largest relative deviation of a tree's frequency."""
ACROSS, DETUNING = 0.4, 1.13
"""Amplitude and frequency across the wind, relative to those along it."""


class Wind(Record, frozen=True):
    """Wind that makes trees and bushes sway."""

    amplitude_m: Annotated[float, Field(gt=0, le=3)] = 0.3
    """Amplitude of the top of a tree 20 m high along the wind (m); others in proportion."""

    direction_deg: float = 0.0
    """Direction of the wind (degrees from +x toward +y)."""

    seed: Annotated[int, Field(ge=0)] = 0
    """Random seed of the phases and frequencies of trees."""


@dataclass(frozen=True)
class Sway:
    """Bending of one tree."""

    foot_m: tuple[float, float, float]
    """(x, y, z): position of its foot."""
    height_m: float
    """Height of its top above the foot."""
    along: tuple[float, float]
    """(x, y): unit vector of the wind."""
    amplitude_m: float
    """Amplitude of the top along the wind."""
    frequency_hz: float
    """Frequency along the wind."""
    phases_rad: tuple[float, float]
    """(along, across): at time 0."""

    def carry(self, points: Floats, time_s: float | Floats) -> Floats:
        """Return displaced points (n, 3) of the tree, at one time or each at its own (n,)."""
        return points + self._bend(points, time_s)

    def undo(self, points: Floats, time_s: float) -> Floats:
        """Return the points on the tree at rest of points (n, 3) at a time."""
        return points - self._bend(points, time_s)  # heights do not change

    def turn(self, normals: Floats, points: Floats, time_s: float) -> Floats:
        """Return unit normals (n, 3) at a time, from those at points (n, 3) of the tree at rest."""
        # Normals transform with the inverse transpose of the bending's Jacobian: I + slope ⊗ z.
        slope = 2 * self._height(points)[:, None] / self.height_m * self._top(time_s)
        turned = normals.copy()
        turned[:, 2] -= (slope * normals[:, :2]).sum(axis=1)
        return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))

    def record(self) -> dict[str, Any]:
        """Return the motion as numbers, for a file."""
        return {"kind": "sway", **asdict(self)}

    def _bend(self, points: Floats, time_s: float | Floats) -> Floats:
        bend = np.zeros_like(points)
        bend[:, :2] = self._height(points)[:, None] ** 2 * self._top(time_s)
        return bend

    def _height(self, points: Floats) -> Floats:
        """Heights (n,) above the foot relative to the tree's; nothing below the foot bends."""
        return np.maximum(points[:, 2] - self.foot_m[2], 0) / self.height_m

    def _top(self, time_s: float | Floats) -> Floats:
        """Displacement of the top (2,), m; at times (n,) displacements (n, 2)."""
        angle = 2 * np.pi * self.frequency_hz * time_s
        along = self.amplitude_m * np.sin(angle + self.phases_rad[0])
        across = ACROSS * self.amplitude_m * np.sin(DETUNING * angle + self.phases_rad[1])
        x, y = self.along
        return np.stack([along * x - across * y, along * y + across * x], axis=-1)


def swaying(
    placements: Iterable[Placement], assets: Mapping[str, Asset], kinds: Iterable[str], wind: Wind
) -> Iterator[Placement]:
    """Yield placements; those of the named kinds each with its own motion in the wind."""
    kinds = frozenset(kinds)
    angle = np.radians(wind.direction_deg)
    along = float(np.cos(angle)), float(np.sin(angle))
    tops = {
        name: max(float(mesh.bounds[1][2]) for mesh in asset.parts.values())
        for name, asset in assets.items()
    }
    for index, placement in enumerate(placements):
        if placement.kind not in kinds:
            yield placement
            continue
        rng = generator(wind.seed, "sway", index)
        height = tops[placement.asset] * float(np.linalg.norm(placement.to_world[:3, 0]))
        deviation = 1 + FREQUENCY_SPREAD * float(rng.uniform(-1, 1))
        first, second = rng.uniform(0, 2 * np.pi, 2).tolist()
        x, y, z = placement.to_world[:3, 3].tolist()
        sway = Sway(
            foot_m=(x, y, z),
            height_m=height,
            along=along,
            amplitude_m=wind.amplitude_m * height / 20,
            frequency_hz=FREQUENCY_TIMES_HEIGHT / height * deviation,
            phases_rad=(first, second),
        )
        yield replace(placement, motion=sway)
