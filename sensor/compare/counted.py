"""Counts of frames that were taken alike."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class CountedFrames:
    """Counts at one light and exposure.

    Attributes
    ----------
    counts : (n, rows, columns)
    exposure_s : float
    light_hz : float
        In the unit of the other levels; 0: in the dark.
    saturated : (n, rows, columns) bool, optional
        Counts that are lower bounds.
    times_s : (n,), optional
        When each exposure began; one after the other where it is not known.
    """

    counts: NDArray[Any]
    exposure_s: float
    light_hz: float = 0.0
    saturated: NDArray[np.bool_] | None = None
    times_s: NDArray[np.float64] | None = None

    @property
    def is_dark(self) -> bool:
        """Whether there was no light."""
        return self.light_hz == 0

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Pixels (rows, columns) that are never full."""
        if self.saturated is None:
            return np.ones(self.counts.shape[1:], np.bool_)
        return np.asarray(~self.saturated.any(axis=0))
