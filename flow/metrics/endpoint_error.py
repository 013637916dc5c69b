"""Errors of velocities of blocks, and of dense flow, against the true flow.

A block's true velocity is the mean over its pixels that are known and visible in the next frame.
The outermost blocks (of dense flow, pixels) are skipped. Forward flow is on the pixels of frame t,
block matching on the blocks of frame t + 1: they differ by the motion itself.

Of pixels, EPE is the length of the difference. Fl counts those off by more than 3 px and 5 % of the
true motion (KITTI 2015). WAUC (Richter, Hayder and Koltun 2017) weighs the share of pixels within
i/20 px by 1 − (i − 1)/100, i = 1 … 100: 100 is perfect. The angular error is that between (u, v, 1)
of flow and truth. A pixel without estimated flow exceeds every limit, and its EPE and angle are
those of zero motion.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.metrics.response_error import for_json

SLOW_PX, FAST_PX = 0.5, 2.0
"""Bounds per frame of the resized image: whole-pixel methods give 0 below half a pixel, and above
two the pyramids and search radii matter."""
OCCLUDED_SHARE = 0.1
"""Share of a block's pixels hidden in the next frame from which it is at an occlusion; its true
velocity is that of its other pixels."""
SPEEDS_PX = (10.0, 40.0)
"""Bounds of the three groups of true motion of pixels, px per frame (MPI-Sintel)"""
GROUPS = ("all", "visible", "occluded", "slow", "medium", "fast")
"""All pixels; those visible in the next frame or not; those that move by less than 10 px, by 10 to
40 px, by more"""

_LEAST_SHARE = 0.5
_STEPS = 100


@dataclass(frozen=True)
class TruthError:
    """Error of velocities against the truth over all blocks and frames; NaN if there are none.

    Undefined velocities (blocks without texture) count as missing, and as a relative error of 1, as
    zero motion would; the errors in px and in degrees are those of the defined ones.
    """

    blocks: int
    """Number of blocks and frames whose true velocity is known, the outermost blocks skipped"""
    missing_fraction: float
    """Fraction of them without a velocity by the method"""
    endpoint_error_px: float
    """Mean length of the difference (px of the resized image per frame)"""
    endpoint_error_median_px: float
    """Median length of the difference (px per frame)"""
    angular_error_deg: float
    """Mean angle between (v_x, v_y, 1) of method and truth; Barron, Fleet and Beauchemin 1994"""
    bias_px: tuple[float, float]
    """Mean difference in x and y, method minus truth (px per frame)"""
    spread_px: tuple[float, float]
    """Standard deviation of the difference in x and y (px per frame)"""
    relative_error_median: float
    """Median of |difference| / |truth|, where the truth is not 0"""
    relative_error_interval: tuple[float, float]
    """95 % interval of that median by order statistics, as if blocks were independent"""
    outlier_fraction: float
    """Fraction with a relative error above 25 %, where the truth is not 0"""

    def to_dict(self) -> dict[str, Any]:
        """Return the fields ready for JSON; None where undefined."""
        return dict(for_json(asdict(self)))


def block_flow(
    true_flow: NDArray[np.floating],
    grid: BlockGrid,
    occluded: Mask | None = None,
    weights: NDArray[np.floating] | None = None,
) -> Floats:
    """Return the true velocity of each block, (T − 1, rows, columns, 2), px of the resized image.

    NaN where less than half of a block's pixels are usable. `true_flow` (T − 1, H, W, 2): forward,
    px of the full image, NaN where undefined; `grid`: blocks in the resized image; `occluded`
    (T − 1, H, W): pixels hidden in the next frame; `weights`, alike: of pixels, 0 to 1, such as the
    share that their flow is true for. Raises ValueError if shapes differ.
    """
    shape = true_flow.shape[:3]
    if true_flow.ndim != 4 or true_flow.shape[-1] != 2:
        raise ValueError(f"true_flow of shape {true_flow.shape}: give (T − 1, H, W, 2)")
    for name, array in (("occluded", occluded), ("weights", weights)):
        if array is not None and array.shape != shape:
            raise ValueError(f"{name} of shape {array.shape}: give {shape}, as the flow")
    is_known = np.isfinite(true_flow).all(axis=-1)
    usable = is_known.astype(np.float64) if weights is None else is_known * weights
    if occluded is not None:
        usable = usable * ~occluded
    y, x = _memberships((shape[1], shape[2]), grid)
    known = np.where(is_known[..., np.newaxis], true_flow, 0) * usable[..., np.newaxis]
    sums = np.stack([y @ known[..., axis] @ x.T for axis in range(2)], axis=-1)
    pixels = y @ usable @ x.T
    enough = (pixels > 0) & (pixels >= _LEAST_SHARE * np.outer(y.sum(axis=1), x.sum(axis=1)))
    scale = np.array([grid.shape[1] / shape[2], grid.shape[0] / shape[1]])
    return np.asarray(sums * scale / np.where(enough, pixels, np.nan)[..., np.newaxis])


def block_share(mask: Mask, grid: BlockGrid) -> Floats:
    """Return the masked share of each block's pixels, (T, rows, columns).

    The mask (T, H, W) is of the full image, such as the pixels hidden in the next frame; the blocks
    are in the resized one.
    """
    y, x = _memberships((mask.shape[1], mask.shape[2]), grid)
    pixels = np.outer(y.sum(axis=1), x.sum(axis=1))
    return np.asarray(y @ mask.astype(np.float64) @ x.T / pixels)


def truth_error(
    velocities: Floats, true_velocities: Floats, among: Mask | None = None
) -> TruthError:
    """Return the error of velocities against those of `block_flow`, without the outermost blocks.

    All arrays (T − 1, rows, columns, 2), px per frame; only the blocks `among` (T − 1, rows,
    columns) count, by default all. Raises ValueError if the shapes differ.
    """
    if velocities.shape != true_velocities.shape:
        raise ValueError(
            f"velocities {velocities.shape} and true velocities {true_velocities.shape} differ in"
            " shape: average the truth over the blocks of the method"
        )
    known = np.isfinite(true_velocities[:, 1:-1, 1:-1]).all(axis=-1)
    if among is not None:
        known &= among[:, 1:-1, 1:-1]
    truth = true_velocities[:, 1:-1, 1:-1][known]
    measured = velocities[:, 1:-1, 1:-1][known]
    defined = np.asarray(np.isfinite(measured).all(axis=-1))
    difference = measured[defined] - truth[defined]
    endpoint = np.hypot(*difference.T)
    speed = np.hypot(*truth.T)
    relative = np.hypot(*(measured - truth)[speed > 0].T) / speed[speed > 0]
    relative = np.sort(np.where(np.isnan(relative), 1.0, relative))
    ranks = len(relative) / 2 + np.array((-0.98, 0.98)) * math.sqrt(len(relative))
    low, high = ranks.round().astype(int).clip(0, max(len(relative) - 1, 0))
    return TruthError(
        blocks=len(truth),
        missing_fraction=_of(np.mean, ~defined),
        endpoint_error_px=_of(np.mean, endpoint),
        endpoint_error_median_px=_of(np.median, endpoint),
        angular_error_deg=_of(np.mean, _angles_deg(measured[defined], truth[defined])),
        bias_px=(_of(np.mean, difference[:, 0]), _of(np.mean, difference[:, 1])),
        spread_px=(_of(np.std, difference[:, 0]), _of(np.std, difference[:, 1])),
        relative_error_median=_of(np.median, relative),
        relative_error_interval=(_of(itemgetter(low), relative), _of(itemgetter(high), relative)),
        outlier_fraction=_of(np.mean, relative > 0.25),  # 2-bit accuracy
    )


def truth_splits(
    velocities: Floats, true_velocities: Floats, hidden: Floats
) -> Mapping[str, TruthError]:
    """Return the errors of groups of blocks, by name: by speed, and by occlusion.

    "slow", "medium" and "fast" partition the blocks, and so do "clear" and "occlusion". Velocities
    as for `truth_error`; `hidden` (T − 1, rows, columns): share that is hidden in the next frame.
    """
    speed = np.hypot(true_velocities[..., 0], true_velocities[..., 1])
    groups = {
        "slow": speed < SLOW_PX,
        "medium": (speed >= SLOW_PX) & (speed < FAST_PX),
        "fast": speed >= FAST_PX,
        "clear": hidden < OCCLUDED_SHARE,
        "occlusion": hidden >= OCCLUDED_SHARE,
    }
    return {name: truth_error(velocities, true_velocities, among) for name, among in groups.items()}


def _memberships(shape: tuple[int, int], grid: BlockGrid) -> tuple[Floats, Floats]:
    """Return 1 where rows of an image (blocks, H), and columns, have their center in a block."""
    memberships = []
    starts, blocks = (grid.top, grid.left), (grid.rows, grid.columns)
    for full, resized, start, number in zip(shape, grid.shape, starts, blocks, strict=True):
        centers = (np.arange(full) + 0.5) * (resized / full)
        index = np.floor((centers - start) / grid.block_px)
        memberships.append(np.where(index == np.arange(number)[:, np.newaxis], 1.0, 0.0))
    return memberships[0], memberships[1]


def angles_deg(first: Floats, second: Floats) -> Floats:
    """Return the angles between vectors (..., 3) of any length, (...)."""
    cross = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.asarray(np.degrees(np.arctan2(cross, np.sum(first * second, axis=-1))))


def _angles_deg(first: Floats, second: Floats) -> Floats:
    """Return the angles between (v_x, v_y, 1) of two lists of velocities (n, 2)."""
    ones = np.ones(len(first))
    return angles_deg(np.column_stack((first, ones)), np.column_stack((second, ones)))


def _of(statistic: Callable[[NDArray[Any]], Any], values: NDArray[Any]) -> float:
    return float(statistic(values)) if values.size else math.nan


@dataclass(frozen=True)
class DenseError:
    """Means over the pixels of a group; NaN without pixels. In px per frame, %, or degrees."""

    pixels: int
    """Number of pixels with known truth"""
    epe_px: float
    """Mean endpoint error"""
    over_1px_percent: float
    over_3px_percent: float
    over_5px_percent: float
    fl_percent: float
    """Pixels with an error over 3 px and over 5 % of the true motion"""
    wauc_percent: float
    angular_deg: float
    missing_percent: float
    """Pixels without a flow"""


_AT_ONCE = 2**20
"""Pixels of which all measures are in memory"""
_LOWER_BITS = 18
_BINS = 2 ** (31 - _LOWER_BITS)


class DenseErrors:
    """Sums of errors by group of pixels; images are added one at a time."""

    def __init__(self) -> None:
        # number of pixels, and sums over them of the other fields of `DenseError`, by group
        self._sums = np.zeros((len(GROUPS), len(fields(DenseError))))
        self.sparsification = np.zeros((2, 2, _BINS))

    def add(
        self,
        flow: NDArray[np.floating],
        truth: NDArray[np.floating],
        occluded: Mask | None = None,
        uncertainty: NDArray[np.floating] | None = None,
    ) -> None:
        """Score one image.

        `flow`, `truth` (H, W, 2): px per frame, NaN where undefined; `occluded` (H, W): pixels not
        visible in the next frame; `uncertainty` (H, W): as for `sparsification`. Raises ValueError
        if shapes differ, or no pixel has a flow.
        """
        if flow.shape != truth.shape:
            raise ValueError(
                f"a flow of {flow.shape[1]} × {flow.shape[0]} px, the truth has"
                f" {truth.shape[1]} × {truth.shape[0]}: give it at full size"
            )
        for name, array in (("occluded", occluded), ("uncertainty", uncertainty)):
            if array is not None and array.shape != truth.shape[:2]:
                raise ValueError(f"{name} of shape {array.shape}: give {truth.shape[:2]}")
        known = np.asarray(np.isfinite(truth).all(axis=-1))
        hidden = np.zeros_like(known) if occluded is None else occluded
        true, answer, hidden = truth[known], flow[known], hidden[known]
        if len(true) and not np.isfinite(answer).all(axis=-1).any():
            raise ValueError(
                "no flow where the truth is known, so nothing to score; give flow there"
            )
        for at in range(0, len(true), _AT_ONCE):
            part = slice(at, at + _AT_ONCE)
            true_px, flow_px = true[part].astype(np.float64), answer[part].astype(np.float64)
            missing = np.asarray(~np.isfinite(flow_px).all(axis=-1))
            flow_px[missing] = 0.0
            speed, epe = np.hypot(*true_px.T), np.hypot(*(flow_px - true_px).T)
            off = np.where(missing, np.inf, epe)
            over = [off > limit for limit in (1, 3, 5)]
            fl = over[1] & (off > 0.05 * speed)
            # WAUC: the weight of all thresholds above an error, as a share
            within = np.clip(_STEPS + 1 - np.maximum(np.ceil(off * _STEPS / 5), 1), 0, _STEPS)
            wauc = within * (within + 1) / (_STEPS * (_STEPS + 1))
            angles = _angles_deg(flow_px, true_px)
            counted, *percents = np.array([speed >= 0, *over, fl, wauc, missing], np.float64)
            *percents, none = 100 * np.array(percents)
            values = np.stack((counted, epe, *percents, angles, none))
            slow, fast = SPEEDS_PX
            by_sight = speed >= 0, ~hidden[part], hidden[part]
            by_speed = speed < slow, (speed >= slow) & (speed < fast), speed >= fast
            self._sums += np.array((*by_sight, *by_speed), np.float64) @ values.T
            if uncertainty is not None:
                self.sparsification += sparsification(epe, uncertainty[known][part])

    @classmethod
    def joined(cls, parts: Iterable["DenseErrors"]) -> "DenseErrors":
        """Join the errors of several sets of images."""
        joined = cls()
        for part in parts:
            joined._sums += part._sums
            joined.sparsification += part.sparsification
        return joined

    def of(self, group: str) -> DenseError:
        """Return the errors of one of `GROUPS`."""
        pixels, *sums = self._sums[GROUPS.index(group)].tolist()
        means = (total / pixels if pixels else math.nan for total in sums)
        return DenseError(int(pixels), *means)


class SparsifiedError(NamedTuple):
    """How well uncertainty sorts pixels by their error; NaN without pixels, or without errors."""

    ause: float
    """Area between the curves of the uncertainty and of the error itself (1); 0: the same order"""
    ause_random: float
    """The same for pixels in random order, as of a constant uncertainty"""
    surest_half_px: float
    """Mean endpoint error of the surer half of the pixels (px per frame)"""


def sparsification(errors: NDArray[np.floating], uncertainty: NDArray[np.floating]) -> Floats:
    """Return pixels and sum of their errors (px) by uncertainty and by error, (2, 2, bins of 3 %).

    Those of several images add. Errors and uncertainties of one shape, px; one that is not finite
    is the largest. Raises ValueError if shapes differ or an uncertainty is negative.
    """
    if errors.shape != uncertainty.shape or (uncertainty < 0).any():
        raise ValueError(
            f"uncertainty of shape {uncertainty.shape}: give {errors.shape}, px, 0 or more"
        )
    values = np.nan_to_num([uncertainty, errors], nan=np.inf, posinf=np.inf).reshape(2, -1)
    with np.errstate(over="ignore"):
        bits = np.abs(values).astype(np.float32).view(np.uint32)
    places = bits >> _LOWER_BITS  # exponent and five bits of the mantissa, in the order of values
    weights = np.ones(errors.size), errors.ravel()
    return np.array([[np.bincount(place, by, _BINS) for by in weights] for place in places])


def ause(errors: NDArray[np.floating], uncertainty: NDArray[np.floating]) -> SparsifiedError:
    """Return how well uncertainty sorts errors, arrays of one shape, as for `sparsification`."""
    return sparsified(sparsification(errors, uncertainty))


def sparsified(bins: Floats) -> SparsifiedError:
    """Return how well the uncertainty sorts the pixels of a `sparsification`.

    The curve is the mean error of the pixels that remain when a share, 0 to 1, of the least sure is
    removed, relative to that of all (Ilg et al., ECCV 2018). Within a bin the order is random, so
    that its pixels have its mean, and the area has a closed form.
    """
    pixels, total_px = bins[0].sum(axis=-1)
    if not total_px:
        return SparsifiedError(math.nan, math.nan, math.nan)
    areas = []
    for counts, sums in bins:
        counts, sums = counts[counts > 0], sums[counts > 0]
        kept, kept_px = np.cumsum(counts)[:-1], np.cumsum(sums)[:-1]
        # ∫ (kept_px + mean·n)/(kept + n) dn over the pixels n of a bin, less that of the mean
        beyond = (kept_px - kept * (sums / counts)[1:]) * np.log1p(counts[1:] / kept)
        areas.append(1 + beyond.sum() / total_px)
    kept, kept_px = np.cumsum(bins[0], axis=-1)
    half_px = np.interp(pixels / 2, [0, *kept], [0, *kept_px]) / (pixels / 2)
    return SparsifiedError(areas[0] - areas[1], 1 - areas[1], float(half_px))
