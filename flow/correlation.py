"""Correlation detectors after insect vision: EMD, NDM and NDS (thesis §4.3.3, Eqs. 4.1 to 4.4).

Every pixel is high-passed over the frames, h; a low-pass of h is its delayed copy, g; neighbors
along x are combined, and the result is low-passed, y. With x the pixel's value in the next frame,

    low += a(x − low)   h = x − low   g += a(h − g)   R = combination of h and g   y += b(R − y)

    EMD: R = g[j]·h[j+1] − h[j]·g[j+1]
    NDM: R = |h[j]·(g[j−1] + g[j+1])|
    NDS: R = |h[j] + g[j−1] + g[j+1]|

Per frame, a = 1/(1 + τ) with the time constant τ in frames. The first frame is taken to have been
there forever. The thesis states the rectification for NDS only; for NDM it is inferred.

The responses encode motion but are no velocities: they depend on contrast, spatial frequency and
brightness too. On ½(1 + C sin(ωt + jφ)), with Hh = (1 − a)(1 − z)/(1 − (1 − a)z) and Hl = a/(1 −
(1 − a)z) at z = exp(−iω), h1 = |Hh|, h2 = |Hl|, φ2 = arg Hl, their means are

    EMD: (C²/4)·h1²·h2·sin φ2·sin φ
    NDM: (C²/4)·h1²·h2·cos φ2·cos φ, before rectification
    NDS: 2A/π with A = (C/2)·h1·√(1 + 4·h2·cos φ·cos φ2 + 4·h2²·cos² φ)

(Eq. 4.3 is misprinted; `sinusoid_response` computes the last two). Motion toward +x has φ < 0 and
the delay φ2 < 0: EMD is then positive.
"""

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numba import njit
from pydantic import Field

from megalopta.flow.detector import Detector, FloatArray, Frames, Responder

FilterStep = Annotated[float, Field(gt=0, le=1)]
_FORGOTTEN = 0.01

Combination = Callable[[FloatArray, FloatArray, int], float]
"""A row of h, the same row of g and a column j to the response there."""


def _compiled(combination: Combination) -> Callable[..., None]:
    """Return all filters of a detector in one pass over the pixels, in place."""
    combine = njit(combination, inline="always")

    @njit  # type: ignore[untyped-decorator]
    def advance(frame: Any, a: float, b: float, low: Any, g: Any, y: Any) -> None:
        h = np.empty(frame.shape[1])
        for i in range(frame.shape[0]):
            for j in range(h.size):
                low[i, j] += a * (frame[i, j] - low[i, j])
                h[j] = frame[i, j] - low[i, j]
                g[i, j] += a * (h[j] - g[i, j])
            for j in range(1, h.size - 1):
                y[i, j] += b * (combine(h, g[i], j) - y[i, j])

    return advance  # type: ignore[no-any-return]


_elementary = _compiled(lambda h, g, j: g[j] * h[j + 1] - h[j] * g[j + 1])
_multiplied = _compiled(lambda h, g, j: h[j] * (g[j - 1] + g[j + 1]))
_rectified_product = _compiled(lambda h, g, j: abs(h[j] * (g[j - 1] + g[j + 1])))
_rectified_sum = _compiled(lambda h, g, j: abs(h[j] + g[j - 1] + g[j + 1]))


class CorrelationDetector(Detector, frozen=True):
    """What EMD, NDM and NDS have in common: their filters and their state."""

    gives: ClassVar[Literal["response", "velocity"]] = "response"

    filter_step: FilterStep
    """Step a of the high-pass and of the delay, 1/(1 + time constant in frames)"""

    output_step: FilterStep = 0.8
    """Step b of the low-pass at the output; 1 is no low-pass"""

    @property
    def memory_frames(self) -> int:
        """Frames until the slowest filter has decayed to 1 %."""
        pole = 1 - min(self.filter_step, self.output_step)
        return math.ceil(math.log(_FORGOTTEN) / math.log(pole)) if pole > 0 else 1

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the filters at rest; see `Detector.start`. First and last column stay NaN."""
        rows, columns = shape
        if rows in (0, 2) or columns < 3:
            raise ValueError(
                f"frames of {rows} × {columns} px: {self.name} needs 3 × 3 px, or one row of 3"
            )
        advance, low = self._combination(), None
        delayed, smoothed = np.zeros((2, *shape))
        smoothed[:, [0, -1]] = np.nan

        def respond(frames: Frames, scale: float) -> FloatArray:
            nonlocal low
            responses = np.empty(frames.shape)
            for frame, response in zip(frames, responses, strict=True):
                scaled = frame * np.float64(scale)
                low = scaled.copy() if low is None else low
                advance(scaled, self.filter_step, self.output_step, low, delayed, smoothed)
                response[:] = smoothed
            return responses

        return respond

    def scored(self, responses: FloatArray) -> FloatArray:
        """Return pixels 2 to N − 1 of each side, as in Eq. 4.5; a single row has no border rows."""
        rows = slice(None) if responses.shape[1] == 1 else slice(1, -1)
        return responses[:, rows, 1:-1, np.newaxis]

    @abstractmethod
    def _combination(self) -> Callable[..., None]: ...


class ElementaryMotionDetector(CorrelationDetector, frozen=True):
    """EMD: directional, positive for motion toward +x; Hassenstein and Reichardt."""

    name: str = "EMD"
    """Short name"""

    label: str = "Elementary motion detector"
    """Name in words"""

    filter_step: FilterStep = 0.30
    """Step a of the high-pass and of the delay, 1/(1 + time constant in frames)"""

    def _combination(self) -> Callable[..., None]:
        return _elementary


class NonDirectionalMultiplication(CorrelationDetector, frozen=True):
    """NDM: blind to the direction of motion, quadratic in contrast."""

    name: str = "NDM"
    """Short name"""

    label: str = "Non-directional multiplication"
    """Name in words"""

    filter_step: FilterStep = 0.625
    """Step a of the high-pass and of the delay, 1/(1 + time constant in frames)"""

    rectified: bool = True
    """Whether the output is the absolute value of the product"""

    def _combination(self) -> Callable[..., None]:
        return _rectified_product if self.rectified else _multiplied


class NonDirectionalSummation(CorrelationDetector, frozen=True):
    """NDS: blind to the direction of motion, linear in contrast; Rivera-Alvidrez."""

    name: str = "NDS"
    """Short name"""

    label: str = "Non-directional summation"
    """Name in words"""

    filter_step: FilterStep = 0.714
    """Step a of the high-pass and of the delay, 1/(1 + time constant in frames)"""

    def _combination(self) -> Callable[..., None]:
        return _rectified_sum
