"""Goodness of fit of a curve, by its residuals over all pixels."""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from megalopta.core.arrays import Floats


class Misfit(NamedTuple):
    """Deviation of counts from a fitted curve."""

    share: float
    """Clearest deviation of a level over the pixels, relative"""
    p: float
    """Chance of as large deviations; NaN: too few levels to tell"""
    of: str = "mean"
    """Moment that deviates most clearly"""

    @property
    def is_clear(self) -> bool:
        """True if the curve does not hold: beyond chance, and beyond a negligible deviation."""
        return self.p < 1e-6 and abs(self.share) > (1e-3 if self.of == "mean" else 5e-3)

    def __str__(self) -> str:
        if np.isnan(self.p):
            return "not tested: too few levels"
        if not self.is_clear:
            return f"fits (p = {self.p:.2g})"
        return f"does not fit: a {self.of} differs by {100 * self.share:+.2g} %"


def pooled_misfit(
    left: Floats, weight: Floats, mean: Floats, parameters: int,
    variances: tuple[Floats, Floats] = (np.empty(0), np.empty(0)),
) -> Misfit:  # fmt: skip
    """Return how far levels, over all pixels, are from curves with so many parameters.

    Residuals, their weights (0: unknown) and fitted means are (levels, …); `variances` are relative
    residuals of variances, and their errors, (levels,).
    """
    pixels = tuple(range(1, left.ndim))
    number = (weight > 0).sum(axis=pixels)
    apart, mean = ((of * (weight > 0)).sum(axis=pixels) for of in (left, mean))
    z_of_means = (left * np.sqrt(weight)).sum(axis=pixels)[number > 0] / np.sqrt(number[number > 0])
    share, error = (of[np.isfinite(variances[1])] for of in variances)
    z = np.concatenate((z_of_means, share / error))
    if z.size <= parameters:
        return Misfit(0.0, np.nan)
    clearest = int(np.argmax(np.abs(z)))
    shares = np.concatenate(((apart / np.maximum(mean, 1e-300))[number > 0], share))
    p = float(chi2.sf(np.square(z).sum(), z.size - parameters))
    return Misfit(float(shares[clearest]), p, "mean" if clearest < z_of_means.size else "variance")
