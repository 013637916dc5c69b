"""Disturbances of light and pixels that a benchmark adds: light that changes unevenly, other noise.

Across the frame, x goes from −1/2 to 1/2 and y, in widths, about 0. "Second" are the frames after
the motion, of a pair the second one.

- **ramp** p, **vignette** p, **shadow** p change the second, by p %; the vignette moves by p % of
  the width, and the shadow falls on a third of the frame, with an edge blurred by 1/40 of it.
- **dispersion** D: counts are negative binomial, Poisson counts whose means have a gamma
  distribution of mean m and variance m·(D − 1), so that their variance is D·m.
- **mismatch** p, **warm** k: gains of p % rms, and clusters of 0.4 % of the pixels, blurred by 0.8
  px, the warmest k times the mean light above it; the same in all frames.
- **rendering** p: gamma-distributed gains of p % rms, independent in every frame.
"""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter

from megalopta.core.arrays import Floats
from megalopta.core.bounded import quoted

AMOUNTS: Mapping[str, float] = {
    **{"ramp": 20, "vignette": 15, "shadow": 40, "dispersion": 2},
    **{"mismatch": 20, "warm": 3, "rendering": 20},
}
"""Default amounts by kind: %, but D of dispersion and times the mean light of warm pixels"""


class Disturbance(NamedTuple):
    """A disturbance and its amount."""

    kind: str
    amount: float

    def __str__(self) -> str:
        """Return its name, such as "ramp 20"."""
        return f"{self.kind} {self.amount:g}"


def disturbance(name: str) -> Disturbance:
    """Return the disturbance of a name, such as "ramp 20", "ramp20" or "shadow".

    Raises ValueError for any other.
    """
    words = re.fullmatch(r" *([a-z]+) *(\d{1,4}(?:\.\d{1,4})?)? *", name)
    kind, amount = words.groups() if words else ("", None)
    if kind not in AMOUNTS:
        known = ", ".join(f"{known} {amount:g}" for known, amount in AMOUNTS.items())
        raise ValueError(f"disturbance {quoted(name)!r} is unknown; choose from {known}")
    chosen = Disturbance(kind, float(amount or AMOUNTS[kind]))
    least, most = (1, 1000) if kind == "dispersion" else (0, 100)
    if not least < chosen.amount <= most:
        raise ValueError(f"{chosen}: give an amount above {least}, up to {most}")
    return chosen


def disturbed_means(means: Floats, disturbance: Disturbance, rng: np.random.Generator) -> Floats:
    """Return disturbed mean counts of mean counts, (T, H, W)."""
    (kind, amount), (frames, height, width) = disturbance, means.shape
    means, share = means.copy(), amount / 100
    second = means[frames // 2 :]
    y, x = np.mgrid[:height, :width] / max(width - 1, 1)
    x, y = x - x.mean(), y - y.mean()
    if kind == "ramp":
        second *= 1 + 2 * share * x
    elif kind == "vignette":
        second *= ((1 + 1.5 * (x**2 + y**2)) / (1 + 1.5 * ((x - share) ** 2 + y**2))) ** 2
    elif kind == "shadow":
        second *= 1 - share * gaussian_filter((x + 0.3 * y > 1 / 6).astype(np.float64), width / 40)
    elif kind == "dispersion":
        means = rng.gamma(means / (amount - 1), amount - 1)
    elif kind == "mismatch":
        means *= np.maximum(rng.normal(1, share, (height, width)), 0.05)
    elif kind == "warm":
        seeds = rng.random((height, width)) < 0.004
        warmth = gaussian_filter(seeds.astype(np.float64), 0.8)
        means += amount * means.mean() * warmth / max(warmth.max(), 1e-9)
    elif kind == "rendering":
        means *= rng.gamma(share**-2, share**2, means.shape)
    return means
