"""How samples of clusters lie in one launch of a kernel, and where they are taken."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi
from megalopta.render.baking.cells import Patches

UInt32 = NDArray[np.uint32]
Integers = NDArray[np.int64]


@dataclass
class Places:
    """Where clusters are sampled: some cells of each, one cluster after the other."""

    patches: Patches
    seen: UInt32
    """Where in each cell a point was seen."""
    draws: int


@dataclass
class Lanes:
    """How the samples of both halves of C clusters lie in one launch.

    A half has as many groups as its cluster has shares, of `size` lanes each.
    """

    shares: Integers
    size: int

    def __post_init__(self) -> None:
        groups = np.repeat(self.shares, 2)
        self._start = np.cumsum(groups) - groups
        self._samples = groups * self.size
        entry = np.repeat(np.arange(len(groups), dtype=np.uint32), groups)
        number = (np.arange(len(entry)) - self._start[entry]).astype(np.uint32)
        lane = dr.arange(mi.UInt, len(entry) * self.size)
        group = lane // self.size
        of_half = dr.gather(mi.UInt, mi.UInt(entry), group)
        first = dr.gather(mi.UInt, mi.UInt(number), group) * self.size
        self.sample = first + lane - group * self.size
        """Number of each lane's sample in its half."""
        self.half = of_half & 1
        self.cluster = of_half >> 1
        self.samples = dr.gather(mi.UInt, mi.UInt(self._samples.astype(np.uint32)), of_half)
        """How many samples each lane's half has."""

    def of_cluster(self, values: UInt32) -> Any:
        """Values of clusters (C,) for lanes."""
        return dr.gather(mi.UInt, mi.UInt(values), self.cluster)

    def means(self, values: list[Any]) -> NDArray[np.float64]:
        """Means (2C, n) over the samples of each half of n values of lanes."""
        sums = [dr.block_sum(each, self.size) for each in values]
        dr.eval(sums)
        groups = np.stack([np.array(each, np.float64) for each in sums], axis=1)
        totals = np.add.reduceat(groups, self._start, axis=0)
        return np.asarray(totals / self._samples[:, None])
