"""Goodness of fit of a curve, by its residuals over all pixels."""

from collections.abc import Sequence
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
    levels: tuple[tuple[int, float], ...] = ()
    """Levels whose mean clearly deviates, and by how much, relative"""

    @property
    def is_clear(self) -> bool:
        """True if the curve does not hold: beyond chance, and beyond a negligible deviation."""
        return self.p < 1e-6 and abs(self.share) > (1e-3 if self.of == "mean" else 5e-3)

    def __str__(self) -> str:
        if np.isnan(self.p):
            return "not tested: too few levels"
        if not self.is_clear:
            return f"fits (p = {self.p:.2g})"
        return f"does not fit ({self.summary()})"

    def summary(self, names: Sequence[object] = ()) -> str:
        """Tell which levels, of these names, deviate by how much: "flat.npy 19 times as high"."""
        if not (names and self.levels):
            return f"a {self.of} {_relative(self.share)}"
        return "; ".join(f"{names[level]} {_relative(share)}" for level, share in self.levels)


def _relative(share: float) -> str:
    text = f"{100 * abs(share):.2g} % too {'high' if share > 0 else 'low'}"
    return f"{1 + share:.2g} times as high" if share > 1 else text


def pooled_misfit(
    left: Floats,
    weight: Floats,
    mean: Floats,
    parameters: int,
    variances: tuple[Floats, Floats] = (np.empty(0), np.empty(0)),
) -> Misfit:
    """Return how far levels, over all pixels, are from curves with so many parameters.

    Residuals, their weights (0: unknown) and fitted means are (levels, …); `variances` are relative
    residuals of variances, and their errors, (levels,).
    """
    pixels = tuple(range(1, left.ndim))
    number = (weight > 0).sum(axis=pixels)
    apart, mean = ((of * (weight > 0)).sum(axis=pixels) for of in (left, mean))
    some = np.flatnonzero(number)
    z_of_means = (left * np.sqrt(weight)).sum(axis=pixels)[some] / np.sqrt(number[some])
    share, error = (of[np.isfinite(variances[1])] for of in variances)
    z = np.concatenate((z_of_means, share / error))
    if z.size <= parameters:
        return Misfit(0.0, np.nan)
    clearest = int(np.argmax(np.abs(z)))
    of_means = (apart / np.maximum(mean, 1e-300))[some]
    size = np.abs(np.log1p(of_means.clip(-0.999)))
    clear = (np.abs(z_of_means) > 5) & (size > max(1e-3, 0.2 * size.max(initial=0)))
    levels = tuple(zip(some[clear].tolist(), of_means[clear].tolist(), strict=True))
    shares = np.concatenate((of_means, share))
    p = float(chi2.sf(np.square(z).sum(), z.size - parameters))
    moment = "mean" if clearest < z_of_means.size else "variance"
    return Misfit(float(shares[clearest]), p, moment, levels)
