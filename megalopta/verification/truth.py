"""`megalopta check truth`: a dataset's flow against a second derivation, and against its images.

Flow is rederived from stored depth, poses and motions, in both directions. The next image is warped
back along the stored flow, and the remaining shift is estimated by least squares on the gradient
(Lucas and Kanade, 1981). Aliasing and moving shadows leave one or two tenths of a pixel; a wrong
sign or a grid off by half a pixel leaves more than the limit.

The truth of whole pixels is compared with that of their centers. Where one object fills the pixel,
its center's flow is rarely farther from the mean than a few spreads. Over the image, the shares of
sky, and of hidden area, sum to the number of pixels with such a center, within chance: a share s
gives a center with a variance of s·(1 − s). Where the centers of neighbors see different objects,
the outline between them crosses one of the two.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.ndimage import gaussian_filter, map_coordinates

from megalopta.core.arrays import Floats
from megalopta.core.bounded import undamaged
from megalopta.core.progress import progress
from megalopta.dataset.reprojection import UNKNOWN, View, motions_of, rederived_flow
from megalopta.dataset.store import Dataset
from megalopta.render import Truth, read_attributes, read_radiance, read_truth
from megalopta.stages.run import require

_MEANING = (
    "at rest and sky: from depth and poses; moving: from position and motion; pixel mean: whole "
    "pixels against their centers; shares: likewise, in standard errors; outlines: share without "
    "mixed pixels; image: shift of the next one, warped back along the flow, beyond noise"
)
_SMOOTHING_PX = 1.0


@dataclass(frozen=True)
class Residual:
    """Residuals of one comparison."""

    name: str
    pixels: int
    """Number of values."""
    median: float
    percentile_99: float
    """Residual's length, px; for shares, in standard errors."""
    limit: float
    """Limit of the median."""

    @property
    def passed(self) -> bool:
        """True if the median is below its limit."""
        return self.median < self.limit


def run_check_truth(dataset: Dataset) -> bool:
    """Check all frames of a dataset and print the table; return True if all passed."""
    dataset.require_truth()
    require(dataset, "render")
    console, rows = Console(), check_truth(dataset)
    console.print(_MEANING, highlight=False)
    table = Table(caption="pass: median below its limit")
    for name in ("residual (px)", "values", "median", "99 %", "limit", "pass"):
        table.add_column(name, justify="left" if name.startswith("residual") else "right")
    for row in rows:
        numbers = (f"{number:.2g}" for number in (row.median, row.percentile_99, row.limit))
        verdict = "[green]yes[/]" if row.passed else "[bold red]NO[/]"
        table.add_row(row.name, f"{row.pixels:,}", *numbers, verdict)
    console.print(table)
    return all(row.passed for row in rows)


def check_truth(dataset: Dataset) -> list[Residual]:
    """Compare all frames of a dataset; needs a finished render stage."""
    motions = motions_of(dataset)
    figures = [number for number, of in motions.items() if of is UNKNOWN]
    residuals: dict[str, list[Floats]] = {}
    frames = dataset.configuration.trajectory.frames
    with progress("Rederiving flow", frames - 1, "pair") as advance:
        for (truth, view, image), (next_truth, next_view, next_image) in pairwise(
            _frame(dataset, index) for index in range(frames)
        ):
            forward = rederived_flow(truth, view, next_view, motions)
            backward = rederived_flow(next_truth, next_view, view, motions)
            for way, seen, stored, again in (
                ("forward", truth, truth.flow_forward, forward),
                ("backward", next_truth, next_truth.flow_backward, backward),
            ):
                is_figure = np.isin(seen.object_id, figures)
                is_moving = np.isin(seen.object_id, list(motions)) & ~is_figure
                groups = {
                    "at rest": ~(is_moving | is_figure) & (seen.object_id > 0),
                    "sky": seen.object_id == 0,
                    "moving": is_moving,
                }
                distance = np.linalg.norm(stored - again, axis=-1)
                undefined = np.isnan(stored).any(axis=-1), np.isnan(again).any(axis=-1)
                distance[undefined[0] ^ undefined[1]] = np.inf
                for name, where in groups.items():
                    if where.any():
                        known = distance[where & ~np.isnan(distance)]
                        residuals.setdefault(f"{name}, {way}", []).append(known)
            for name, values in footprint_residuals(truth):
                residuals.setdefault(name, []).append(values)
            shift = remaining_shift(image, next_image, truth)
            if np.isfinite(shift):
                residuals.setdefault("image, warped", []).append(np.array([shift]))
            advance()
    checked = []
    for name in sorted(residuals):
        values, kind = np.concatenate(residuals[name]), name.split(" ")[0].rstrip(",")
        # px, a share of outlines, standard errors, and px of rederived flow
        limit = {"image": 0.3, "outlines": 0.1}.get(kind, 5.0 if "share" in name else 1e-3)
        known = values if values.size else [0.0]
        median, high = np.percentile(known, [50, 99], method="nearest").tolist()
        checked.append(Residual(name, values.size, median, high, limit))
    return checked


def remaining_shift(image: Floats, following: Floats, truth: Truth) -> float:
    """Length (px) of the remaining shift of an image (H, W) and the next one, warped by its flow.

    Less three standard errors; NaN where nothing is visible in both.
    """
    height, width = image.shape
    x = np.arange(width) + truth.flow_forward[..., 0]
    y = np.arange(height)[:, None] + truth.flow_forward[..., 1]
    margin = 2
    inside = (x > margin) & (x < width - 1 - margin) & (y > margin) & (y < height - 1 - margin)
    inside &= ~truth.occluded_forward
    if not inside.any():
        return float("nan")
    # Smoothing before and after warping gives both the same filter, and stable gradients.
    # Pixels without a partner take this image's value and have no effect.
    warped = image.copy()
    warped[inside] = map_coordinates(following, [y[inside], x[inside]], order=3, mode="nearest")
    first, second = (gaussian_filter(values, _SMOOTHING_PX) for values in (image, warped))
    down, right = np.gradient((first + second) / 2)
    slope, difference = np.stack([right, down], axis=-1)[inside], (first - second)[inside]
    shift, *_ = np.linalg.lstsq(slope, difference, rcond=None)
    left = ((difference - slope @ shift) ** 2).mean()
    # Smoothed noise is alike over an area of 4πσ².
    squared_error = 4 * np.pi * _SMOOTHING_PX**2 * left * np.trace(np.linalg.pinv(slope.T @ slope))
    return float(max(np.linalg.norm(shift) - 3 * np.sqrt(squared_error), 0))


def _frame(dataset: Dataset, index: int) -> tuple[Truth, View, Floats]:
    """Return truth, camera and brightness (H, W) of a frame."""
    path, light = dataset.frame("truth", index), dataset.frame("radiance", index)
    remedy = f"remove the file and run: {dataset.render_again}"
    with undamaged(path, remedy):
        truth = read_truth(path)
        view = View.of(dataset.configuration.camera, read_attributes(path))
    with undamaged(light, remedy):
        radiance, _ = read_radiance(light)
    return truth, view, radiance.sum(axis=-1, dtype=np.float64)


def footprint_residuals(truth: Truth) -> Iterator[tuple[str, Floats]]:
    """Yield names and values of the differences in a frame.

    Means in px, sums of shares in standard errors, outlines as the share without mixed pixels.
    """
    footprint = truth.footprint
    objects, is_mixed = truth.object_id, footprint.is_mixed
    borders = [  # of different objects: True where neither side is mixed
        ~(is_mixed[side] | is_mixed[neighbor])[objects[side] != objects[neighbor]]
        for side, neighbor in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1]))
    ]
    if (is_missed := np.concatenate(borders)).size:
        yield "outlines missed, share", np.array([is_missed.mean()])
    yield "sky share, in standard errors", _standard_errors(footprint.sky, truth.object_id == 0)
    for way in ("forward", "backward"):
        flow, pixel = getattr(truth, f"flow_{way}"), getattr(footprint, way)
        if np.isnan(flow).all():
            continue
        hidden = getattr(truth, f"occluded_{way}")
        yield f"hidden share {way}, in standard errors", _standard_errors(pixel.hidden, hidden)
        pure = ~footprint.is_mixed & np.isfinite(flow).all(axis=-1)
        away = np.linalg.norm(flow[pure] - pixel.mean[pure], axis=-1)
        yield f"pixel mean, {way}", np.maximum(away - 4 * pixel.spread[pure], 0)


def _standard_errors(share: NDArray[np.float32], center: NDArray[np.bool_]) -> Floats:
    """Distance (1,) of the sum of shares (H, W) from the centers' (H, W), in standard errors."""
    shares = share.astype(np.float64)
    if (shares < 0).any() or (shares > 1).any() or np.isnan(shares).any():
        return np.array([np.inf])
    # Along a level horizon all pixels of a row differ alike, along a wall those of a column.
    differences = shares - center
    by_chance = np.where((shares > 0) & (shares < 1), differences, 0)
    lines = max(float((by_chance.sum(axis=axis) ** 2).sum()) for axis in (0, 1))
    # One ray more or less in a pixel is not an error of the whole.
    error = np.sqrt(max((shares * (1 - shares)).sum(), lines) + 1)
    return np.array([abs(differences.sum()) / error])
