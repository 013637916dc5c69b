"""A table in the memory of the device, which grows by rows."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render import dr, mi

FIRST_ROWS = 2**12


class Table:
    """Rows of `width` numbers each; `count` are filled."""

    def __init__(self, width: int) -> None:
        self._width, self.count = width, 0
        self._values = dr.zeros(mi.Float, FIRST_ROWS * width)

    def rows(self) -> Floats:
        """All of it (count, width)."""
        filled = np.array(self._values, np.float64)[: self.count * self._width]
        return filled.reshape(-1, self._width)

    def column(self, row: Any, column: int, active: Any) -> Any:
        """One column of rows (N,)."""
        return dr.gather(mi.Float, self._values, row * self._width + column, active)

    def put(self, rows: Floats) -> None:
        """Append rows (C, width)."""
        first, self.count = self.count, self.count + len(rows)
        size, needed = dr.width(self._values), self.count * self._width
        if needed > size:
            grown = dr.zeros(mi.Float, max(needed, 2 * size))
            dr.scatter(grown, self._values, dr.arange(mi.UInt, size))
            self._values = grown
        self.write(rows, np.arange(first, self.count, dtype=np.uint32))

    def write(self, rows: Floats, row: NDArray[np.uint32]) -> None:
        """Set rows (C,) to (C, width)."""
        place = (row[:, None] * self._width + np.arange(self._width)).astype(np.uint32)
        values = mi.Float(rows.astype(np.float32).ravel())
        dr.scatter(self._values, values, mi.UInt(place.ravel()))
        dr.eval(self._values)
        dr.sync_thread()
