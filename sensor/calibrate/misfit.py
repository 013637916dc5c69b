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
            return "not tested, as it fits whatever is recorded"
        if not self.is_clear:
            return f"fits (p = {self.p:.2g})"
        return f"does not fit: a {self.of} differs by {100 * self.share:+.2g} %"


def pooled_misfit(
    left: Floats,
    weight: Floats,
    mean: Floats,
    parameters: int,
    variances: tuple[Floats, Floats] = (np.empty(0), np.empty(0)),
) -> Misfit:
    """Return how far levels, over all pixels, are from curves with so many parameters.

    Residuals, their weights (0: unknown) and fitted means are (levels, P); `variances` are relative
    residuals of variances, and their errors, (levels,).
    """
    pixels = (weight > 0).sum(axis=1)
    used = pixels > 0
    z = [(left * np.sqrt(weight)).sum(axis=1)[used] / np.sqrt(pixels[used])]
    apart, of = ((values * (weight > 0)).sum(axis=1)[used] for values in (left, mean))
    shares = [apart / np.maximum(of, 1e-300)]
    known = np.isfinite(variances[1])
    z.append(variances[0][known] / variances[1][known])
    shares.append(variances[0][known])
    freedom = z[0].size + z[1].size - parameters
    if freedom < 1:
        return Misfit(0.0, np.nan)
    clearest = int(np.argmax(np.abs(np.concatenate(z))))
    share, p = (
        float(np.concatenate(shares)[clearest]),
        chi2.sf(np.square(np.concatenate(z)).sum(), freedom),
    )
    return Misfit(share, float(p), "mean" if clearest < z[0].size else "variance")
