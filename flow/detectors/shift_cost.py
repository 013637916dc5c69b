"""How unlike two frames of counts are, block by block and shift by shift, and the best shift.

Two Poisson counts x and y of one mean have the log-likelihood ratio against two means of their own
x·ln(2x/(x + y)) + y·ln(2y/(x + y)) ≈ (√x − √y)². The root makes the noise the same in the dark and
in the light, so a sum of squared differences of roots is the likelihood of a shift, up to a factor
for counts that were smoothed. A plain sum of squared differences prefers dark candidates, whose
noise is smaller.

The minimum is refined by the parabola through its 3 × 3 neighborhood, which is meant for frames
smoothed by at least 0.7 px; on sharper ones it draws velocities toward whole pixels. A neighborhood
in which only one frame's part moves sees another strip of texture on either side, which tilts the
parabola: the costs around the minimum are to be those of both frames' parts (`neighbor_shifts`).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from megalopta.flow.detectors.base import FloatArray

_DEGENERATE = 0.05
"""Share of fxx·fyy below which the determinant of the parabola says nothing across the edge."""


# A sum of its own for each row, cut out beforehand, lets the compiler vectorize.
@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})  # type: ignore[untyped-decorator]
def add_costs(
    first: NDArray[np.float32],
    second: NDArray[np.float32],
    weights: NDArray[np.float32],
    origins: NDArray[np.int64],
    corners: NDArray[np.int64],
    size: int,
    costs: FloatArray,
) -> None:
    """Add Σ weight·(second − first)² over blocks of `second` and parts of `first` near an origin.

    Parameters
    ----------
    first, second : (H, W)
        Roots of smoothed counts.
    weights : (H, W)
        Of the pixels of `second`.
    origins : (n, 2)
        Row and column in `first` of the part that the middle of `costs` compares with.
    corners : (n, 2)
        Row and column of each block in `second`; the blocks must lie inside.
    size : int
        Side of a block (px).
    costs : (n, 2·radius + 1, 2·radius + 1)
        Changed in place. Entry [radius + dy, radius + dx] compares with the part dx to the *left*
        and dy *above* the origin: content that moved by (+dx, +dy). Parts that leave the frame
        cost infinity.
    """
    height, width = first.shape
    radius = costs.shape[1] // 2
    for block in range(len(corners)):
        row, column = corners[block, 0], corners[block, 1]
        for dy in range(-radius, radius + 1):
            for dx in range(-radius, radius + 1):
                top, left = origins[block, 0] - dy, origins[block, 1] - dx
                if top < 0 or left < 0 or top + size > height or left + size > width:
                    costs[block, radius + dy, radius + dx] = np.inf
                    continue
                cost = np.float32(0)
                for y in range(size):
                    here = second[row + y, column : column + size]
                    weight = weights[row + y, column : column + size]
                    there = first[top + y, left : left + size]
                    row_cost = np.float32(0)
                    for x in range(size):
                        difference = here[x] - there[x]
                        row_cost += weight[x] * difference * difference
                    cost += row_cost
                costs[block, radius + dy, radius + dx] += cost


def least_cost(costs: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the shift (x, y) of least cost of each block, (n, 2), and whether there is one, (n,).

    There is none where all costs are equal, as without photons, or none is finite.

    Parameters
    ----------
    costs : (n, 2·radius + 1, 2·radius + 1)
        As from `add_costs`.
    """
    blocks, side = costs.shape[:2]
    y, x = np.divmod(costs.reshape(blocks, -1).argmin(axis=1), side)
    highest = np.where(np.isfinite(costs), costs, -np.inf).max(axis=(1, 2))
    return np.stack((x, y), axis=-1) - side // 2, highest > costs.min(axis=(1, 2))


def parabola_minimum(costs: FloatArray) -> FloatArray:
    """Return where (x, y) the parabola through 3 × 3 costs has its minimum, (n, 2), at most 1 away.

    0 along an axis on which a cost is infinite or the middle is no minimum.

    Parameters
    ----------
    costs : (n, 3, 3)
    """
    c = {(i, j): costs[:, 1 + i, 1 + j] for i in (-1, 0, 1) for j in (-1, 0, 1)}
    with np.errstate(invalid="ignore", divide="ignore"):
        fx, fxx = (c[0, 1] - c[0, -1]) / 2, c[0, 1] - 2 * c[0, 0] + c[0, -1]
        fy, fyy = (c[1, 0] - c[-1, 0]) / 2, c[1, 0] - 2 * c[0, 0] + c[-1, 0]
        fxy = (c[1, 1] - c[1, -1] - c[-1, 1] + c[-1, -1]) / 4
        determinant = fxx * fyy - fxy**2
        coupled = determinant > _DEGENERATE * fxx * fyy
        x = np.where(coupled, (fxy * fy - fyy * fx) / determinant, -fx / fxx)
        y = np.where(coupled, (fxy * fx - fxx * fy) / determinant, -fy / fyy)
        steps = np.where(np.stack((fxx, fyy), axis=-1) > 0, np.stack((x, y), axis=-1), 0)
    return np.where(np.isfinite(steps), np.clip(steps, -1, 1), 0)
