"""Common parts of the estimators of OpenCV and scikit-image: gray levels in, blocks out.

Photon counts are mapped to gray levels pair by pair, by one linear map of both frames: the darkest
pixel of the two becomes 0, the brightest 1, and neither gain nor offset of the counts changes a
velocity. Values beyond the middle 98 % of the pixels by more than three times the spread of these,
such as hot pixels, are clipped. 256 levels of 8 bits are finer than the photon noise wherever a
pixel holds more than (span/255)²/12 photons.

Photon noise grows with the light. With `stretch`, the counts n are first transformed to
2·√(n + 3/8), whose noise is the same in the dark and in the light (Anscombe 1948).

A method with `takes_counts` gets the counts themselves, or their transform, without that map.

A pair without contrast has no velocity (NaN). Velocities belong to the first frame of a pair.
"""

import hashlib
import inspect
import traceback
from abc import abstractmethod
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_serializer
from scipy.ndimage import gaussian_filter

from megalopta.core.arrays import Floats
from megalopta.core.bounded import quoted
from megalopta.core.errors import UserError
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid, block_grid, mean_over_blocks

_MIDDLE_PERCENT, _SPREADS = (1, 99), 3.0

DenseFlow: TypeAlias = Callable[[Floats, Floats], Any]
"""Maps two frames (H, W) to the flow (H, W, 2) from the first to the second, px, x before y."""


class GrayDetector(BlockDetector, frozen=True):
    """A block detector on pairs of pictures with gray levels from 0 to 1."""

    stretch: Literal["none", "anscombe", "denoised"] = "none"
    """Transform of counts; anscombe gives all of them the same noise, which denoised removes by
    non-local means"""
    blur_px: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Standard deviation of a Gaussian blur after the transform"""

    def velocities(self, grid: BlockGrid, window: list[Frames]) -> Floats:
        """Return the velocities of a pair of frames, NaN without contrast."""
        pair = self._levels(np.stack(window))
        if pair is None:
            return np.full((grid.rows, grid.columns, 2), np.nan)
        return self._estimate(grid, pair)

    def _levels(self, pair: Frames) -> Floats | None:
        """Return gray levels of a pair of frames, or counts; None without contrast."""
        stretched = self._stretched(pair)
        return stretched.astype(np.float64) if self.takes_counts else gray_levels(stretched)

    def _stretched(self, pair: Frames) -> Frames:
        if self.stretch != "none":
            pair = 2 * np.sqrt((pair + 3 / 8).clip(0))
        if self.stretch == "denoised":
            # Buades et al. (2005), with scikit-image's strength; the noise is 1
            from skimage.restoration import denoise_nl_means

            settings = {"patch_size": 5, "patch_distance": 6, "h": 0.8, "sigma": 1.0}
            pair = np.stack([denoise_nl_means(frame, **settings, fast_mode=True) for frame in pair])
        if self.blur_px:
            sigma = (0, self.blur_px, self.blur_px)
            pair = gaussian_filter(pair.astype(np.float64), sigma, mode="nearest")
        return pair

    @abstractmethod
    def _estimate(self, grid: BlockGrid, pair: Floats) -> Floats:
        """Return the velocities of the blocks between two frames (2, H, W), from 0 to 1."""


def eight_bits(pair: Floats) -> NDArray[np.uint8]:
    """Return gray levels from 0 to 1 as 0 to 255, rounded."""
    return np.rint(255 * pair).astype(np.uint8)


def gray_levels(pair: Frames) -> Floats | None:
    """Return two frames (2, H, W) with gray levels from 0 to 1; None without contrast."""
    exact = pair.astype(np.float64)
    low, high = np.percentile(exact, _MIDDLE_PERCENT)
    # if nearly all pixels are alike, the others are the picture
    spread = _SPREADS * (high - low) or np.inf
    darkest, brightest = max(exact.min(), low - spread), min(exact.max(), high + spread)
    if brightest > darkest:
        return np.asarray((np.clip(exact, darkest, brightest) - darkest) / (brightest - darkest))
    return None


class MethodError(UserError, ValueError):
    """A foreign method fails, or returns something else than flow; the message names it."""


class DenseDetector(GrayDetector, frozen=True):
    """Dense flow of pairs of pictures; a block's velocity is the mean over its pixels.

    A flow that is undefined at a pixel leaves its block undefined.
    """

    def dense(self, *frames: Frames) -> Floats:
        """Return the flow (H, W, 2) from one frame to the next, NaN without contrast."""
        sequence = self.as_counts(self.checked(frames))
        grid = block_grid((sequence.shape[1], sequence.shape[2]), self.block_px, 1)
        pair = self._levels(sequence)
        return np.full((*grid.shape, 2), np.nan) if pair is None else self._checked(grid, pair)

    def _estimate(self, grid: BlockGrid, pair: Floats) -> Floats:
        return mean_over_blocks(self._checked(grid, pair), grid)

    def _checked(self, grid: BlockGrid, pair: Floats) -> Floats:
        flow, expected = np.asarray(self._flow(grid, pair), np.float64), (*grid.shape, 2)
        if flow.shape != expected:
            raise MethodError(
                f"{self.name}: a flow of shape {flow.shape}; give {expected}, x before y"
            )
        if np.isinf(flow).any():
            raise MethodError(f"{self.name}: infinite flow; give NaN where it is undefined")
        return flow

    @abstractmethod
    def _flow(self, grid: BlockGrid, pair: Floats) -> NDArray[Any]:
        """Return the flow (H, W, 2) between two frames (2, H, W), from 0 to 1."""


class ZeroMotion(DenseDetector, frozen=True):
    """No motion at all, which every other method must beat."""

    place: ClassVar[float] = 16
    name: str = "zero"
    label: str = "No motion"

    def _flow(self, grid: BlockGrid, _: Floats) -> Floats:
        return np.zeros((*grid.shape, 2))


class FunctionDetector(DenseDetector, frozen=True):
    """The flow of a function, averaged over blocks."""

    function: DenseFlow
    """Maps two frames (H, W), gray levels from 0 to 1 or counts, to their flow (H, W, 2)"""

    @field_serializer("function")
    def _identity(self, function: DenseFlow) -> str:
        """Return an identity of the function, for stored results: its source and closure."""
        try:
            enclosed = sorted(inspect.getclosurevars(function).nonlocals.items())
            body = f"{inspect.getsource(function)}{enclosed}"
        except (OSError, TypeError):  # built in, or from an interactive session
            body = repr(function)
        place = f"{function.__module__}.{getattr(function, '__qualname__', repr(function))}"
        place += " counts" * self.takes_counts
        return f"{place} {hashlib.sha256(body.encode()).hexdigest()}"

    def _flow(self, _: BlockGrid, pair: Floats) -> Floats:
        try:
            return np.asarray(self.function(pair[0], pair[1]), np.float64)
        except Exception as problem:  # foreign code can raise any exception
            stack = [*traceback.walk_tb(problem.__traceback__)]
            module = getattr(self.function, "__module__", None)
            of_module = [call for call in stack if call[0].f_globals.get("__name__") == module]
            frame, line = (of_module or stack)[-1]  # not a line of NumPy
            failure = f"{type(problem).__name__}: {' '.join(str(problem).split())}"
            raise MethodError(
                f"method {self.name}: {quoted(failure)} at {frame.f_code.co_filename}:{line}; give"
                " a function of two frames (H, W) that returns their flow (H, W, 2)"
            ) from problem


class CountsDetector(FunctionDetector, frozen=True):
    """The flow of a function of counts."""

    takes_counts: ClassVar[bool] = True


def detector_from(
    function: DenseFlow, name: str | None = None, label: str | None = None, counts: bool = False
) -> FunctionDetector:
    """Return a detector that calls a function for the flow between neighboring frames.

    It maps two frames (H, W) float64 to their flow (H, W, 2) in px, x before y; NaN where
    undefined. Frames are gray levels from 0 to 1, the extremes of both, or with `counts` the photon
    counts themselves. Default names are the function's.
    """
    short = name or getattr(function, "__name__", type(function).__name__)
    return (CountsDetector if counts else FunctionDetector)(
        name=short, label=label or short, function=function
    )
