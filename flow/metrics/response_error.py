"""Distance of the response to photon counts from that to the noise-free sequence.

Thesis Eq. 4.5, on the pixels or blocks that a detector scores (`Detector.scored`):

    literal: mean of |R_stoch − R_ideal| / |R_ideal|, the denominator at least 1e-20
    ratio:   Σ|R_stoch − R_ideal| / Σ|R_ideal|

`literal` is the dissertation's; where responses pass through zero, its mean is dominated by a few
pixels. Neither compares with the true motion: a consistently wrong detector has error zero.

Blocks whose ideal velocity is zero or undefined are not scored (0/0), nor are, in `literal`,
frames whose ideal response is zero everywhere. An undefined response to noise where the ideal one
is defined counts as error 1.

Errors are quotients of sums over the scored pixels or blocks of each frame, (4, …, T):
Σ|R_stoch − R_ideal|/|R_ideal|, Σ|R_stoch − R_ideal|, Σ|R_ideal|, and the number of them.
"""

import math
from typing import Any, Literal

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.flow.detectors.base import Detector

Metric = Literal["literal", "ratio"]
METRICS: tuple[Metric, ...] = ("literal", "ratio")


def error_sums(detector: Detector, ideal: Floats, noisy: Floats) -> Floats:
    """Return the sums (4, T) of a detector's responses (T, H, W) or (T, rows, columns, 2)."""
    sums = np.zeros((4, len(ideal)))
    skip_zero = detector.gives == "velocity"
    _add_up(detector.scored(ideal), detector.scored(noisy), skip_zero, sums)
    return sums


def error_parts(sums: Floats, metric: Metric) -> tuple[Floats, Floats]:
    """Return numerator and denominator of the error of each frame, (…, T), from sums (4, …, T)."""
    relative, deviation, magnitude, scored = sums
    if metric == "literal":
        responds = magnitude > 0
        return relative * responds, scored * responds
    return deviation, magnitude


def error_of(sums: Floats, metric: Metric) -> float:
    """Return the error over all frames; NaN if the ideal response is zero everywhere."""
    numerator, denominator = error_parts(sums, metric)
    return float(quotient(numerator.sum(), denominator.sum()))


def quotient(numerator: Floats | np.float64, denominator: Floats | np.float64) -> Floats:
    """Return a/b, NaN where b is 0: nothing was scored, or nothing moved."""
    undefined = np.full(np.shape(denominator), np.nan)
    return np.divide(numerator, denominator, out=undefined, where=np.asarray(denominator) > 0)


def for_json(value: Any) -> Any:
    """Return a value, or a container, with None in place of NaN, which JSON lacks."""
    if isinstance(value, dict):
        return {name: for_json(item) for name, item in value.items()}
    if isinstance(value, tuple | list):
        return [for_json(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value


@compiled
def _add_up(ideal: Floats, noisy: Floats, skip_zero: bool, sums: Floats) -> None:
    frames, rows, columns, components = ideal.shape
    size, difference = np.empty(columns), np.empty(columns)
    for t in range(frames):
        for i in range(rows):
            for j in range(columns):
                size[j] = abs(ideal[t, i, j, 0])
                difference[j] = abs(noisy[t, i, j, 0] - ideal[t, i, j, 0])
                if components > 1:
                    size[j] = np.hypot(size[j], ideal[t, i, j, 1])
                    further = noisy[t, i, j, 1] - ideal[t, i, j, 1]
                    difference[j] = np.hypot(difference[j], further)
            _add_row(size, difference, skip_zero, sums[:, t])


@compiled(fastmath={"reassoc"})
def _add_row(size: Floats, difference: Floats, skip_zero: bool, sums: Floats) -> None:
    """Add a row; branch-free, for vector instructions."""
    relative = deviation = magnitude = scored = 0.0
    for j in range(size.size):
        counts = (size[j] > 0) | ((size[j] == 0) & (not skip_zero))
        of_ideal = size[j] if counts else 0.0
        off = of_ideal if np.isnan(difference[j]) | (not counts) else difference[j]
        relative += off / max(of_ideal, 1e-20)  # smallest denominator
        deviation += off
        magnitude += of_ideal
        scored += 1.0 if counts else 0.0
    sums[0] += relative
    sums[1] += deviation
    sums[2] += magnitude
    sums[3] += scored
