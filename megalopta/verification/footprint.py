"""What the truth says of whole pixels, against what it says of their centers.

A center is a place like any other of its pixel. Where one thing fills the pixel, its flow is one of
those that mean and spread are of, and so is rarely farther from the mean than a few spreads. And
over the image the shares of sky, and of what is hidden, come to as many pixels as have such a
center, within what chance leaves: a share of s makes a center with a variance of s·(1 − s). Where
the centers of neighbors see different things, the outline between them crosses one of the two.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render import Truth

_FARTHEST_SPREADS = 4.0


def footprint_residuals(truth: Truth) -> Iterator[tuple[str, Floats]]:
    """Yield names and values of what differs in a frame.

    Means in px, sums of shares in standard errors, of outlines the part that no mixed pixel is on.
    """
    footprint = truth.footprint
    if (missed := _missed_outlines(truth)) is not None:
        yield "outlines missed, part", np.array([missed])
    yield "sky share, of error", _standard_errors(footprint.sky, truth.object_id == 0)
    for way in ("forward", "backward"):
        flow, found = getattr(truth, f"flow_{way}"), getattr(footprint, way)
        if np.isnan(flow).all():
            continue
        hidden = getattr(truth, f"occluded_{way}")
        yield f"hidden share {way}, of error", _standard_errors(found.hidden, hidden)
        pure = ~footprint.is_mixed & np.isfinite(flow).all(axis=-1)
        away = np.linalg.norm(flow[pure] - found.mean[pure], axis=-1)
        yield f"pixel mean, {way}", np.maximum(away - _FARTHEST_SPREADS * found.spread[pure], 0)


def _missed_outlines(truth: Truth) -> float | None:
    """Part of the borders between pixels of different objects that neither neighbor is mixed by."""
    things, mixed = truth.object_id, truth.footprint.is_mixed
    missed = [
        ~(mixed[here] | mixed[there])[things[here] != things[there]]
        for here, there in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1]))
    ]
    borders = np.concatenate(missed)
    return float(borders.mean()) if borders.size else None


def _standard_errors(share: NDArray[np.float32], center: NDArray[np.bool_]) -> Floats:
    """How far (1,) the sum of shares (H, W) is from the centers' (H, W), in standard errors."""
    shares = share.astype(np.float64)
    if (shares < 0).any() or (shares > 1).any() or np.isnan(shares).any():
        return np.array([np.inf])
    # A ray more or less in one pixel is no error of the whole.
    error = np.sqrt((shares * (1 - shares)).sum() + 1)
    return np.array([abs(shares.sum() - center.sum()) / error])
