"""Number of views of each cell in a sequence, and random numbers derived from a cell alone.

Before baking, a survey of the whole sequence finds each cell's area in the frames and place. Of a
cell that extends into the ground or a stone only a part is visible, and light on the rest is
irrelevant. So one visible point is kept of each cell.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.render import dr, mi
from megalopta.render.baking.cells import CellFinder, UInt32, pixel_angle
from megalopta.render.numbers import hashed
from megalopta.scenes.cameras.base import Camera

_PLACES = 1024
"""Number of places along a side of a cell."""
_CHANCE_SHIFT = 20
"""Bits of a place."""
VIEWS = 512
"""Rays per pixel over the whole sequence, of any length. These miss the cells of 1 in 20 rays of a
frame."""


def views(camera: Camera, poses: Floats, count: int, seed: int, step: int = 1) -> Iterator[Any]:
    """Rays for every `step`-th pixel from `count` poses spread over those (T, 4, 4).

    For each view the camera is turned by up to half a pixel at random, so that rays also sample
    between pixel centers.
    """
    axes = camera.directions().reshape(-1, 3)[::step]
    turns = np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3)) * pixel_angle(camera)
    frames = np.linspace(0, len(poses) - 1, count).round().astype(int)
    for pose, turn in zip(poses[frames], turns, strict=True):
        directions = Rotation.from_rotvec(turn).apply(axes) @ pose[:3, :3].T
        start = mi.Point3f(pose[:3, 3].tolist())
        dr.make_opaque(start)  # otherwise every view would be compiled anew
        yield mi.Ray3f(start, mi.Vector3f(np.ascontiguousarray(directions.T)))


def survey(
    loaded: Any, finder: CellFinder, cells: int, rays: Iterable[Any]
) -> tuple[UInt32, UInt32, UInt32]:
    """Cells (N,) of `cells` that the rays of some views see, in ascending order.

    Also the number of times (N,) that each is seen, and a place (N,) where, as read by `unpacked`.
    """
    pages = Pages(cells)
    seen, places = dr.zeros(mi.UInt, 0), dr.zeros(mi.UInt, 0)
    for number, each in enumerate(rays):
        sight = finder.look(loaded, each)
        dr.eval(sight.cell, sight.shaded, sight.place)
        at = pages.of(sight.cell, sight.shaded)
        seen, places = pages.grown(seen, 0), pages.grown(places, 0)
        dr.scatter_add(seen, mi.UInt(1), at, sight.shaded)
        # Randomly the first, independent of the order of threads.
        chance, _ = hashed(dr.arange(mi.UInt, dr.width(sight.cell)), dr.opaque(mi.UInt, number))
        packed = (chance >> _CHANCE_SHIFT << _CHANCE_SHIFT) | _packed(*sight.place)
        dr.scatter_reduce(dr.ReduceOp.Max, places, packed, at, sight.shaded)
        dr.eval(seen, places)
    met = np.flatnonzero(np.array(seen))
    cell = pages.cells(met)
    met, cell = met[np.argsort(cell)], np.sort(cell)
    return cell, np.array(seen)[met], np.array(places)[met]


def _packed(a: Any, b: Any) -> Any:
    """Places in cells, (a, b), packed in the lower bits of integers."""
    i, j = (mi.UInt(dr.clip(x, 0, 1) * (_PLACES - 1) + 0.5) for x in (a, b))
    return i * _PLACES + j


def unpacked(places: Any) -> tuple[Any, Any]:
    """Places in cells, (a, b), 0 to 1."""
    i, j = (places // _PLACES) % _PLACES, places % _PLACES
    return mi.Float(i) / (_PLACES - 1), mi.Float(j) / (_PLACES - 1)


SIZE = 64
"""Cells of a page. The table of pages takes four bytes for each."""
_NONE = 2**32 - 1


class Pages:
    """Places of some of `cells` cells, numbered from 0 without large gaps.

    Of the cells of a forest less than one in a hundred is seen. Neighbors are seen together, so
    places are given to a page of cells at a time, when the first of them is asked for.
    """

    def __init__(self, cells: int) -> None:
        self._page: Any = dr.full(mi.UInt, _NONE, cells // SIZE + 1)
        self._number = np.zeros(0, np.uint32)

    @property
    def places(self) -> int:
        """Number of places given so far."""
        return len(self._number) * SIZE

    def of(self, cell: Any, active: Any) -> Any:
        """Return the places of active cells (N,), with new ones for pages that had none."""
        number = cell // SIZE
        page = dr.gather(mi.UInt, self._page, number, active)
        lanes: Any = dr.compress(active & (page == _NONE))
        if dr.width(lanes):
            new = np.unique(np.array(dr.gather(mi.UInt, number, lanes)))
            # From an array: a literal would be compiled anew each time.
            pages = np.arange(len(new), dtype=np.uint32) + np.uint32(len(self._number))
            self._number = np.concatenate([self._number, new])
            dr.scatter(self._page, mi.UInt(pages), mi.UInt(new))
            dr.eval(self._page)
            page = dr.gather(mi.UInt, self._page, number, active)
        return page * SIZE + cell % SIZE

    def cells(self, place: NDArray[np.integer]) -> NDArray[np.uint32]:
        """Return the cells at places (N,)."""
        return np.asarray(self._number[place // SIZE] * SIZE + place % SIZE, np.uint32)

    def grown(self, values: Any, filler: int) -> Any:
        """Return values of places (P,), extended to all places given so far by a filler."""
        width = dr.width(values)
        if width >= max(self.places, 1):  # nothing is scattered to or gathered from no place
            return values
        new = np.full(max(width, self.places - width, 1), filler, np.uint32)
        return mi.UInt(np.concatenate([np.array(values, np.uint32), new]))
