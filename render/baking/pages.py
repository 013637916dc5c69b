"""Places for the few cells that are seen among very many.

Of the cells of a forest less than one in a hundred is seen. Neighbors are seen together, so places
are given to a page of cells at a time, when the first of them is asked for.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi

SIZE = 64
"""Cells of a page. The table of pages takes four bytes for each."""
_NONE = 2**32 - 1


class Pages:
    """Places of some of `cells` cells, numbered from 0 without large gaps."""

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
