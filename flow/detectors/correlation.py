"""Correlation detectors after insect vision: EMD, NDM, NDS (dissertation §4.3.3, Eqs. 4.1 to 4.4).

Every pixel is high-passed over the frames, h; a low-pass of h is its delayed copy, g; neighbors
along x are combined, and the result is low-passed, y. With x the pixel's value in the next frame,

    low += a(x − low)   h = x − low   g += a(h − g)   R = combination of h and g   y += b(R − y)

    EMD: R = g[j]·h[j+1] − h[j]·g[j+1]
    NDM: R = |h[j]·(g[j−1] + g[j+1])|
    NDS: R = |h[j] + g[j−1] + g[j+1]|

Per frame, a = 1/(1 + τ) with the time constant τ in frames. The first frame is taken to have been
there forever. The dissertation states the rectification for NDS only; for NDM it is inferred.
Motion toward +x has a phase φ < 0 from pixel to pixel and the delay φ2 < 0: EMD is then positive.
Mean responses to a sinusoid: `docs/theory/correlators.md`.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.flow.detectors.base import Detector, Frames, Responder

FilterStep = Annotated[float, Field(gt=0, le=1)]

_ELEMENTARY, _PRODUCT, _RECTIFIED_PRODUCT, _RECTIFIED_SUM = range(4)


@compiled
def _combine(kind: int, h: Any, g: Any, combined: Any) -> None:
    """Combine a row of h and one of its delayed copy g; the outermost pixels lack a neighbor."""
    inner = range(1, h.size - 1)
    if kind == _ELEMENTARY:
        for j in inner:
            combined[j] = g[j] * h[j + 1] - h[j] * g[j + 1]
    elif kind == _RECTIFIED_SUM:
        for j in inner:
            combined[j] = abs(h[j] + g[j - 1] + g[j + 1])
    else:
        for j in inner:
            combined[j] = h[j] * (g[j - 1] + g[j + 1])
        if kind == _RECTIFIED_PRODUCT:
            for j in inner:
                combined[j] = abs(combined[j])


class _Filters(NamedTuple):
    """Parameters of `_advance`: its combination, the factor on frames, and both steps."""

    kind: int
    scale: float
    a: float
    b: float


@compiled
def _advance(frames: Any, filters: _Filters, state: Any, outputs: Any) -> None:
    """Pass frames through all filters; their states low, g and y (3, H, W) change in place."""
    kind, scale, a, b = filters
    low, g, y = state[0], state[1], state[2]
    h, combined = np.empty(frames.shape[2]), np.empty(frames.shape[2])
    for t in range(frames.shape[0]):
        for i in range(frames.shape[1]):
            for j in range(h.size):
                pixel = frames[t, i, j] * scale
                low[i, j] += a * (pixel - low[i, j])
                h[j] = pixel - low[i, j]
                g[i, j] += a * (h[j] - g[i, j])
            _combine(kind, h, g[i], combined)
            for j in range(1, h.size - 1):
                y[i, j] += b * (combined[j] - y[i, j])
                outputs[t, i, j] = y[i, j]
            outputs[t, i, 0] = outputs[t, i, h.size - 1] = np.nan


class CorrelationDetector(Detector, frozen=True):
    """Common filters and state of EMD, NDM and NDS."""

    gives: ClassVar[Literal["response", "velocity"]] = "response"
    _combination: ClassVar[int]

    filter_step: FilterStep
    """Step a of the high-pass and of the delay, 1/(1 + time constant in frames)"""
    output_step: FilterStep = 0.8
    """Step b of the low-pass at the output; 1: no low-pass"""

    @property
    def memory_frames(self) -> int:
        """Frames after which less than 1 % of the past remains in the delayed copy, smoothed."""
        return _settled(self.filter_step, self.output_step, power=1)

    @property
    def noise_memory_frames(self) -> int:
        """Frames after which less than 1 % of the power of white noise remains in it."""
        return _settled(self.filter_step, self.output_step, power=2)

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the filters at rest; see `Detector.start`. First and last column stay NaN."""
        rows, columns = shape
        if rows in (0, 2) or columns < 3:
            raise ValueError(
                f"frames of {rows} × {columns} px: {self.name} needs 3 × 3 px, or one row of 3"
            )
        return self._from(np.zeros((3, *shape)), is_new=True)

    def after(self, frames: Frames, scale: float) -> Callable[[float], Responder]:
        """Return a function that starts with the filters' states; see `Detector.after`."""
        if not len(frames):
            return super().after(frames, scale)
        # computed once: an offset passes through the first low-pass only
        state = np.zeros((3, *frames.shape[1:]))
        state[0] = frames[0] * np.float64(scale)
        self._pass(frames, scale, state)

        def start(offset: float) -> Responder:
            changed = state.copy()
            changed[0] += offset
            return self._from(changed)

        return start

    def _from(self, state: Floats, is_new: bool = False) -> Responder:
        """Return filters in a state; in a new one the first frame precedes the sequence forever."""

        def respond(frames: Frames, scale: float) -> Floats:
            nonlocal is_new
            if is_new and len(frames):
                state[0], is_new = frames[0] * np.float64(scale), False
            return self._pass(frames, scale, state)

        return respond

    def _pass(self, frames: Frames, scale: float, state: Floats) -> Floats:
        """Return the responses, and change the state in place."""
        responses = np.empty(frames.shape)
        filters = _Filters(self._kind, float(scale), self.filter_step, self.output_step)
        _advance(frames, filters, state, responses)
        return responses

    def scored(self, responses: Floats) -> Floats:
        """Return pixels 2 to N − 1 of each side, as in Eq. 4.5; a single row has no border rows."""
        rows = slice(None) if responses.shape[1] == 1 else slice(1, -1)
        return responses[:, rows, 1:-1, np.newaxis]

    @property
    def _kind(self) -> int:
        return self._combination


@cache
def _settled(filter_step: float, output_step: float, power: int) -> int:
    """Return the number of frames after which 1 % of the response to one bright frame remains."""
    # high-pass, delay and low-pass at the output: three poles, two of them equal
    frames = math.ceil(30 / min(filter_step, output_step))  # after which e⁻³⁰ remains
    delay, smoothing = (
        np.fft.rfft(step * (1 - step) ** np.arange(frames), 2 * frames)
        for step in (filter_step, output_step)
    )
    response = np.abs(np.fft.irfft((1 - delay) * delay * smoothing)[:frames]) ** power
    left = 1 - np.cumsum(response) / max(response.sum(), 1e-20)  # a step of 1 leaves nothing
    return 1 + int(np.argmax(left < 0.01))


class ElementaryMotionDetector(CorrelationDetector, frozen=True):
    """EMD: directional, positive for motion toward +x; Hassenstein and Reichardt."""

    place: ClassVar[float] = 3
    _combination: ClassVar[int] = _ELEMENTARY

    name: str = "EMD"
    label: str = "Elementary motion detector"
    filter_step: FilterStep = 0.30


class NonDirectionalMultiplication(CorrelationDetector, frozen=True):
    """NDM: blind to the direction of motion, quadratic in contrast."""

    place: ClassVar[float] = 4

    name: str = "NDM"
    label: str = "Non-directional multiplication"
    filter_step: FilterStep = 0.625
    rectified: bool = True
    """True if the output is the absolute value of the product"""

    @property
    def _kind(self) -> int:
        return _RECTIFIED_PRODUCT if self.rectified else _PRODUCT


class NonDirectionalSummation(CorrelationDetector, frozen=True):
    """NDS: blind to the direction of motion, linear in contrast; Rivera-Alvidrez."""

    place: ClassVar[float] = 5
    _combination: ClassVar[int] = _RECTIFIED_SUM

    name: str = "NDS"
    label: str = "Non-directional summation"
    filter_step: FilterStep = 0.714


def ndm_mean(filter_step: float, omega: ArrayLike, phase: float, contrast: float) -> Floats:
    """Return the mean response of NDM before rectification, (C²/4)·h1²·h2·cos φ2·cos φ (Eq. 4.2).

    `filter_step`: step a of the high-pass and of the delay, 0 < a < 1; `omega`: temporal frequency,
    rad per frame; `phase`: spatial frequency φ, rad per pixel; `contrast`: Michelson contrast C.
    """
    high_pass, delayed = _gains(filter_step, omega)
    return np.asarray(contrast**2 / 4 * high_pass**2 * delayed.real * np.cos(phase))


def nds_mean(filter_step: float, omega: ArrayLike, phase: float, contrast: float) -> Floats:
    """Return the mean response of NDS, rectified: 2A/π, A = (C/2)·h1·|1 + 2·Hl·cos φ|.

    Parameters and shape as for `ndm_mean`.
    """
    high_pass, delayed = _gains(filter_step, omega)
    amplitude = contrast / 2 * high_pass * np.abs(1 + 2 * delayed * np.cos(phase))
    return np.asarray(2 / np.pi * amplitude)


def _gains(step: float, omega: ArrayLike) -> tuple[Floats, np.ndarray]:
    """Amplitude h1 of the high-pass and complex gain Hl of the delay."""
    z = np.exp(-1j * np.asarray(omega, dtype=float))
    pole = 1 - (1 - step) * z
    return np.abs((1 - step) * (1 - z) / pole), step / pole
