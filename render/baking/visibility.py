"""How often a sequence sees each cell, and random numbers that follow from a cell alone.

A look at the whole sequence before anything is baked: how much of it each cell fills, and where. Of
a cell that reaches into the ground or into a stone only a part is ever seen, and what arrives at
the rest is no light of it. So a point is kept of each cell that was seen.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.render import dr, mi
from megalopta.render.baking.cells import CellFinder, UInt32, pixel_angle
from megalopta.render.mitsuba_loader import PlugIn, registered
from megalopta.scenes.cameras.base import Camera

# Fractional parts of irrational numbers that are independent over the rationals, times 2³²:
# 1/p and 1/p² of the plastic number p (Roberts' R₂ sequence), √2, √3 and √5.
_STEPS = tuple(
    round(2**32 * x)
    for x in (0.7548776662466927, 0.5698402909980532, 2**0.5 - 1, 3**0.5 - 1, 5**0.5 - 2)
)


def hashed(first: Any, second: Any) -> tuple[Any, Any]:
    """Two random 32-bit numbers from two."""
    values: Any = mi.sample_tea_32(first, second)
    return values[0], values[1]


def recurrence(index: Any, key: Any) -> list[Any]:
    """Points `index` of five additive recurrences modulo 1, shifted by a key.

    They fill the unit hypercube evenly; whole numbers keep them exact.
    """
    shifts = [shift for salt in (1, 2, 3) for shift in hashed(key, mi.UInt(salt))]
    return [
        mi.Float((index * mi.UInt(step) + shift) >> 8) * 2.0**-24
        for step, shift in zip(_STEPS, shifts, strict=False)
    ]


def _generator(*state: Any) -> Any:
    pcg32: Any = mi.PCG32
    return pcg32(*state)


class _CellSampler(PlugIn):
    """Random numbers, started from a cluster's key and the index of a sample."""

    base = "Sampler"

    def __init__(self, properties: Any) -> None:
        self.above.__init__(self, properties)
        self.generator = _generator()

    def start(self, key: Any, sample: Any) -> None:
        state, stream = mi.sample_tea_64(key, sample), mi.sample_tea_64(sample, key)
        self.generator = _generator(1, state, stream)

    def schedule_state(self) -> None:
        dr.schedule(self.generator)

    def next_1d(self, active: Any = True) -> Any:
        return self.generator.next_float32()

    def next_2d(self, active: Any = True) -> Any:
        return mi.Point2f(self.next_1d(active), self.next_1d(active))


def cell_sampler() -> Any:
    """Mitsuba sampler to be started from a cluster's key and the index of a sample."""
    return mi.load_dict({"type": registered(_CellSampler)})


_PLACES = 1024
"""Of places along a side of a cell."""
_CHANCE_SHIFT = 20
"""Bits of a place."""
VIEWS = 512
"""Rays per pixel over the whole sequence, however long. One in twenty of a frame meets what these
did not."""


def views(camera: Camera, poses: Floats, count: int, seed: int, step: int = 1) -> Iterator[Any]:
    """A ray for every `step`-th pixel from each of `count` poses spread over those (T, 4, 4).

    For each view the camera is turned by up to half a pixel at random, so that rays meet what lies
    between pixel centers.
    """
    axes = camera.directions().reshape(-1, 3)[::step]
    turns = np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3)) * pixel_angle(camera)
    frames = np.linspace(0, len(poses) - 1, count).round().astype(int)
    for pose, turn in zip(poses[frames], turns, strict=True):
        directions = Rotation.from_rotvec(turn).apply(axes) @ pose[:3, :3].T
        start = mi.Point3f(pose[:3, 3].tolist())
        dr.make_opaque(start)  # or every view would be compiled anew
        yield mi.Ray3f(start, mi.Vector3f(np.ascontiguousarray(directions.T)))


def survey(
    loaded: Any, finder: CellFinder, cells: int, rays: Iterable[Any]
) -> tuple[UInt32, UInt32]:
    """How often (cells,) each cell is seen by the rays of some views.

    And where (cells,) each was seen once, as `unpacked` reads it.
    """
    seen, places = dr.zeros(mi.UInt, cells), dr.zeros(mi.UInt, cells)
    for number, each in enumerate(rays):
        sight = finder.look(loaded, each)
        dr.scatter_add(seen, mi.UInt(1), sight.cell, sight.shaded)
        # The one that chance puts first, whatever the order in which threads come.
        chance, _ = hashed(dr.arange(mi.UInt, dr.width(sight.cell)), dr.opaque(mi.UInt, number))
        packed = (chance >> _CHANCE_SHIFT << _CHANCE_SHIFT) | _packed(*sight.place)
        dr.scatter_reduce(dr.ReduceOp.Max, places, packed, sight.cell, sight.shaded)
        dr.eval(seen, places)
    return np.array(seen), np.array(places)


def _packed(a: Any, b: Any) -> Any:
    """Where in cells, (a, b), in the lower bits of whole numbers."""
    i, j = (mi.UInt(dr.clip(x, 0, 1) * (_PLACES - 1) + 0.5) for x in (a, b))
    return i * _PLACES + j


def unpacked(places: Any) -> tuple[Any, Any]:
    """Where in cells, (a, b), 0 to 1."""
    i, j = (places // _PLACES) % _PLACES, places % _PLACES
    return mi.Float(i) / (_PLACES - 1), mi.Float(j) / (_PLACES - 1)
