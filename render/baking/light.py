"""What cells send out, computed once and kept: the part of shading that no view changes.

For each cell that is asked for, and each band, the table keeps the radiance that leaves where the
texture's weight is 0 and where it is 1, and of both how far the halves of the samples are apart
(`gathering`). With the weight w the surface shows (1 − w) of the one and w of the other.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi
from megalopta.render.baking.gathering import STRIDE, Gatherer

NOT_BAKED = 2**32 - 1
LEAST_RAYS = 2 * STRIDE
"""Fewest rays of a cell, both halves together."""
MOST_RAYS = 2**12
"""Most of a cell that is seldom seen; others have up to 64 times as many."""

# Rays traced at once, in about a second: what they bring is kept until it is summed, and Ctrl-C
# waits for them.
RAYS_AT_ONCE = 2**20
FIRST_ROWS = 2**12
# A cell's noise weighs with how much of the sequence it fills; a given number of rays leaves the
# least noise when samples grow as the square root of that.
_MOST_SHARES = 64


class BakedLight:
    """Radiance that the cells of a scene send out, without what the sun's disc adds directly.

    `rays` is that of a cell that is seldom seen.
    """

    def __init__(self, gatherer: Gatherer, cells: int, bands: int, rays: int) -> None:
        self._gatherer, self.cells, self._bands = gatherer, cells, bands
        self._forget(rays)

    def _forget(self, rays: int) -> None:
        self.rays = rays
        self._shares = np.ones(self.cells, np.uint16)
        self._row = dr.full(mi.UInt, NOT_BAKED, self.cells)
        self._table = dr.zeros(mi.Float, FIRST_ROWS * self._width)
        self._baked: list[NDArray[np.uint32]] = []
        self.baked_cells = 0

    @property
    def _width(self) -> int:
        return 4 * self._bands

    def begin(self, seen: NDArray[np.uint32], rays: int) -> None:
        """Start anew with other numbers of rays; `seen` (cells,) is how often each cell was."""
        self._forget(rays)
        self._shares = np.sqrt(seen).round().clip(1, _MOST_SHARES).astype(np.uint16)

    @property
    def baked(self) -> NDArray[np.uint32]:
        """Cells (C,) that have their light."""
        return np.concatenate([np.zeros(0, np.uint32), *self._baked])

    def rays_of(self, cell: NDArray[np.uint32]) -> int:
        """How many rays cells (C,) take."""
        return int(self._shares[cell].sum(dtype=np.int64)) * self.rays

    def bake_missing(self, cell: Any, active: Any) -> None:
        """Compute the light of those cells (N,) that have none yet."""
        lanes: Any = dr.compress(
            active & (dr.gather(mi.UInt, self._row, cell, active) == NOT_BAKED)
        )
        if dr.width(lanes):
            self.bake(np.unique(np.array(dr.gather(mi.UInt, cell, lanes))))

    def bake(self, cell: NDArray[np.uint32]) -> None:
        """Compute the light of cells (C,), each once."""
        if not len(cell):
            return
        self._reserve(self.baked_cells + len(cell))
        shares = self._shares[cell].astype(np.int64)
        least = self.rays // 2
        ends = np.cumsum(2 * least * shares)
        parts = np.searchsorted(ends, np.arange(RAYS_AT_ONCE, ends[-1], RAYS_AT_ONCE))
        for part, its_shares in zip(np.split(cell, parts), np.split(shares, parts), strict=True):
            if len(part):
                halves = self._gatherer.leaving(part, its_shares, least)
                apart = (halves[:, 0] - halves[:, 1]) / 2
                self._put(part, np.concatenate([halves.mean(axis=1), apart], axis=1))

    def radiance(self, cell: Any, weight: Any, active: Any) -> list[Any]:
        """Radiance of each band leaving cells (N,) where the texture's weight is (N,)."""
        return self._mixed(0, cell, weight, active)

    def standing(self, cell: Any, weight: Any, active: Any) -> list[Any]:
        """Half the difference of the two halves of `radiance`, with its error as deviation."""
        return self._mixed(2 * self._bands, cell, weight, active)

    def contents(self) -> dict[str, NDArray[Any]]:
        """All that was baked: cells (C,) and their rows of the table (C, 4·bands)."""
        cells = self.baked
        rows = np.array(self._table)[: self.baked_cells * self._width]
        return {"rays": np.array(self.rays), "cells": cells, "rows": rows.reshape(-1, self._width)}

    def restore(self, contents: dict[str, NDArray[Any]]) -> None:
        """Take what `contents` gave."""
        self._forget(int(contents["rays"]))
        self._reserve(len(contents["cells"]))
        self._put(contents["cells"], contents["rows"])

    def _mixed(self, column: int, cell: Any, weight: Any, active: Any) -> list[Any]:
        start: Any = dr.gather(mi.UInt, self._row, cell, active) * self._width + column
        bands = self._bands
        first, second = (
            [dr.gather(mi.Float, self._table, start + k + band, active) for band in range(bands)]
            for k in (0, bands)
        )
        return [dr.lerp(a, b, weight) for a, b in zip(first, second, strict=True)]

    def _put(self, cell: NDArray[np.uint32], rows: NDArray[np.floating]) -> None:
        """Append rows (C, 4·bands) of cells (C,) to the table."""
        first = self.baked_cells
        # Opaque: a number that changes would make Dr.Jit compile anew every time.
        place = dr.arange(mi.UInt, rows.size) + dr.opaque(mi.UInt, first * self._width)
        dr.scatter(self._table, mi.Float(rows.astype(np.float32).ravel()), place)
        row = dr.arange(mi.UInt, len(cell)) + dr.opaque(mi.UInt, first)
        dr.scatter(self._row, row, mi.UInt(cell))
        dr.eval(self._table, self._row)
        dr.sync_thread()
        self._baked.append(cell)
        self.baked_cells += len(cell)

    def _reserve(self, rows: int) -> None:
        size, needed = dr.width(self._table), rows * self._width
        if needed > size:
            grown = dr.zeros(mi.Float, max(needed, 2 * size))
            dr.scatter(grown, self._table, dr.arange(mi.UInt, size))
            self._table = grown
