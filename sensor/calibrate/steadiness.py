"""Drift of a recording: its second half against its first."""

from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats


class Drift(NamedTuple):
    """Mean of the second half of a series less that of the first, and its standard error."""

    change: float
    error: float

    @property
    def z(self) -> float:
        """Change in standard errors."""
        return self.change / max(self.error, 1e-300) if self.change else 0.0


def drift(series: Floats) -> Drift:
    """Return the drift of one value per frame, (n,), of independent frames."""
    half = len(series) // 2
    first, second = series[:half], series[half:]
    error = np.sqrt(first.var(ddof=1) / first.size + second.var(ddof=1) / second.size)
    return Drift(float(second.mean() - first.mean()), float(error))
