"""Error that stands on surfaces in all frames, from the distance of some pixels to traced paths.

The mean over some pixels of D², where D is the difference between baked light and that of traced
paths, is too large by the variance of the paths. That variance is known from the scatter of the
groups that a pixel's paths come in; without it, what is left has the squared standing error as its
mean, whatever that comes from. Pixels are compared in pairs of neighbors, so that the gradient of
the error is known in the same way. Where few pixels or noisy paths bring that to less than the
bake's own scatter, it is taken to be the latter: there is no less.
"""

from dataclasses import dataclass

import numpy as np

from megalopta.core.arrays import Floats, Mask
from megalopta.render.noise import MeasuredPass

# Pixels, or pairs of them, that say more than the scatter of the bake does.
_FEWEST = 8


@dataclass(frozen=True)
class Standing:
    """The error that all frames share."""

    draw: Floats  # (H, W, B)
    differences: Floats  # (H, W, G, B)

    @classmethod
    def of(cls, measured: MeasuredPass | None, like: Floats) -> "Standing":
        """That of a pass; none where there is no such pass."""
        empty = np.zeros((*like.shape[:2], 0, like.shape[2]))
        if measured is None:
            return cls(np.zeros_like(like), empty)
        found = measured.differences
        draw = measured.standing.astype(np.float64)
        return cls(draw, empty if found is None else found.astype(np.float64))

    def covariance(self, part: Mask) -> Floats:
        """Mean square between bands (B, B) over a part (H, W) of the pixels."""
        found, scatter = self._compared(self.differences, part), _mean_square(self.draw[part])
        if len(found) < _FEWEST:
            return scatter
        return max(_without_scatter(found), scatter, key=np.sum)

    def slope(self, part: Mask) -> float:
        """Mean square of what the error of neighbors, summed over bands, differs by."""
        draws, found = [], []
        for axis, both in enumerate(pairs(part)):
            draws.append(np.diff(self.draw.sum(axis=-1), axis=axis)[both])
            each = np.diff(self.differences.sum(axis=-1, keepdims=True), axis=axis)
            found.append(self._compared(each, both))
        compared = np.concatenate(found)
        scatter = float(_mean_square(np.concatenate(draws)[:, None]).sum())
        if len(compared) < _FEWEST:
            return scatter
        return max(float(_without_scatter(compared).sum()), scatter)

    def squares(self, part: Mask) -> Floats:
        """Of each pixel (H, W), summed over bands: those of the draw, with the mean that is due."""
        draw = self.draw.sum(axis=-1) ** 2
        mean = draw[part].mean()
        due = max(float(self.covariance(part).sum()), 0.0)
        return np.asarray(draw * (due / mean) if mean > 0 else np.full_like(draw, due))

    @staticmethod
    def _compared(differences: Floats, part: Mask) -> Floats:
        inside = differences[part]
        if not inside.shape[1]:
            return inside[:0]
        return np.asarray(inside[np.isfinite(inside).all(axis=(1, 2))])


def _mean_square(values: Floats) -> Floats:
    return np.asarray(values.T @ values / max(len(values), 1))


def _without_scatter(groups: Floats) -> Floats:
    """Mean product (B, B) of the means of independent groups (n, G, B), free of their scatter.

    Diagonal elements are not negative.
    """
    n, count, bands = groups.shape
    sums = groups.sum(axis=1)
    each = groups.reshape(n * count, bands)
    product = (sums.T @ sums - each.T @ each) / (n * count * (count - 1))
    scale = np.sqrt(np.maximum(product.diagonal(), 0))
    return np.asarray(np.clip(product, -np.outer(scale, scale), np.outer(scale, scale)))


def slopes(pixels: Floats) -> list[Floats]:
    """Differences between neighbors in columns and in rows, of the sum over bands."""
    return [np.diff(pixels.sum(axis=-1), axis=axis) for axis in (0, 1)]


def pairs(part: Mask) -> list[Mask]:
    """Neighbors in columns and in rows that both lie in a part."""
    return [part[1:] & part[:-1], part[:, 1:] & part[:, :-1]]
