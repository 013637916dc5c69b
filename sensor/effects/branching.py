"""How an avalanche of one pixel adds to the counts of the others, after all generations.

With C_ij the mean number of counts of pixel i that one of pixel j adds at once, one more count in j
leads to G_ij = [(1 − C)⁻¹]_ij in i, and independent noise of variance D_j in every pixel to

    Var_i = Σ_j G_ij²·D_j

C_ij = g_i·w(i − j)·s_j: a kernel of a few pixels, how a pixel answers to an arrival, and how
strongly another sends. G falls off within some steps of the kernel. Where g and s are the same
everywhere, G depends on the place only near the border: it is taken from an array so small that it
can be solved at once and so large that its far border does not matter; an image smaller than that
is solved as it is. Else every pixel has its own row of G, g_i·w·s added step after step. What is
left out of Var_i is below 1e-8 of it.
"""

from functools import lru_cache

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled

REACH = 3
"""Largest distance along a row or column that crosstalk goes at once, pixels."""
_NEGLIGIBLE = 1e-9
_LARGEST_HALF_WIDTH = 14


def summed_squares(
    noise: Floats, weights: Floats, answer: Floats, strength: Floats | None = None
) -> Floats:
    """Σ_j G_ij²·noise_j of every pixel i.

    Parameters
    ----------
    noise : (rows, columns) float64
    weights : (7, 7) float64
        The kernel w, the same in all four directions.
    answer : (rows, columns) float64
        g, 1 or less.
    strength : (rows, columns) float64, optional
        s; by default 1.
    """
    gain = float(answer.max(initial=0))
    is_alike = strength is None and np.ptp(answer) <= 1e-6 * gain if answer.size else True
    largest = gain * (1.0 if strength is None else float(strength.max(initial=0)))
    half = _half_width(weights * largest)
    total = np.empty_like(noise)
    if is_alike:
        rows, columns = (min(length, 2 * half + 1) for length in noise.shape)
        squares = _squares(rows, columns, tuple((weights * gain).ravel()))
        _gather(noise, squares, half, total)
    else:
        scale = np.ones_like(noise) if strength is None else strength
        _walk(noise, _taps(weights), answer, scale, half, _steps(weights.sum() * largest), total)
    return total


def _steps(strength: float) -> int:
    """Generations after which less than `_NEGLIGIBLE` is left."""
    return min(int(np.ceil(np.log(_NEGLIGIBLE) / np.log(min(max(strength, 1e-9), 0.95)))), 400)


def _half_width(weights: Floats) -> int:
    """Distance at which the square of the response to a kernel is negligible.

    Along a line G falls as e^(−κ·distance), where the kernel's sum, weighed with cosh(κ·column), is
    1; found by bisection.
    """
    columns = weights.sum(0)
    away = np.arange(columns.size) - columns.size // 2
    low, high = 0.0, 20.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (
            (middle, high) if (columns * np.cosh(middle * away)).sum() < 1 else (low, middle)
        )
    most = _LARGEST_HALF_WIDTH
    return most if low == 0 else min(int(np.ceil(-np.log(_NEGLIGIBLE) / (2 * low))) + 1, most)


def _taps(weights: Floats) -> Floats:
    """Return rows of (down, right, weight) of what is not 0 in a kernel."""
    places = np.argwhere(weights)
    return np.column_stack((places - weights.shape[0] // 2, weights[tuple(places.T)]))


@lru_cache(maxsize=16)
def _squares(rows: int, columns: int, weights: tuple[float, ...]) -> Floats:
    """G² of an array, (rows, columns, rows, columns)."""
    side = int(len(weights) ** 0.5)
    taps = _taps(np.reshape(weights, (side, side)))
    places = np.indices((rows, columns)).reshape(2, -1)
    matrix = np.eye(rows * columns)
    for down, right, weight in taps:
        to = places + np.array([[int(down)], [int(right)]])
        inside = (to >= 0).all(0) & (to[0] < rows) & (to[1] < columns)
        matrix[to[0, inside] * columns + to[1, inside], np.flatnonzero(inside)] -= weight
    return np.asarray(np.linalg.inv(matrix).reshape(rows, columns, rows, columns) ** 2)


@compiled
def _gather(noise: Floats, squares: Floats, half: int, total: Floats) -> None:
    """Sum over the small array, laid over the image so that borders fall on borders."""
    rows, columns, _, _ = squares.shape
    for y in range(noise.shape[0]):
        top = min(max(y - half, 0), noise.shape[0] - rows)
        for x in range(noise.shape[1]):
            left = min(max(x - half, 0), noise.shape[1] - columns)
            summed = 0.0
            for row in range(rows):
                for column in range(columns):
                    square = squares[y - top, x - left, row, column]
                    summed += square * noise[top + row, left + column]
            total[y, x] = summed


@compiled
def _walk(
    noise: Floats,
    taps: Floats,
    answer: Floats,
    strength: Floats,
    half: int,
    steps: int,
    total: Floats,
) -> None:
    """Rows of G one by one: e_i, e_i·C, e_i·C², … inside a window about the pixel."""
    rows, columns = noise.shape
    side = 2 * half + 1
    for y in range(rows):
        for x in range(columns):
            row, term = np.zeros((side, side)), np.zeros((side, side))
            term[half, half] = row[half, half] = 1.0
            for step in range(steps):
                longer = np.zeros((side, side))
                near = min((step + 1) * 3, half)
                for v in range(half - near, half + near + 1):
                    for u in range(half - near, half + near + 1):
                        down, right = y + v - half, x + u - half
                        if term[v, u] == 0 or not (0 <= down < rows and 0 <= right < columns):
                            continue
                        for tap in range(taps.shape[0]):
                            b, a = v + int(taps[tap, 0]), u + int(taps[tap, 1])
                            if 0 <= b < side and 0 <= a < side:
                                longer[b, a] += term[v, u] * answer[down, right] * taps[tap, 2]
                left = 0.0
                for v in range(side):
                    for u in range(side):
                        down, right = y + v - half, x + u - half
                        if 0 <= down < rows and 0 <= right < columns:
                            longer[v, u] *= strength[down, right]
                            row[v, u] += longer[v, u]
                            left += longer[v, u]
                        else:
                            longer[v, u] = 0.0
                term = longer
                if left < 1e-9:
                    break
            summed = 0.0
            for v in range(side):
                for u in range(side):
                    if row[v, u] > 0:
                        summed += row[v, u] ** 2 * noise[y + v - half, x + u - half]
            total[y, x] = summed
