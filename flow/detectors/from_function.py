"""A detector made of a plain function that gives the flow between two frames.

    photon_benchmark(frames, ["LK", detector_from(my_flow)], settings, seed=0, sequence="mine")

The function gets gray levels from 0 to 1, as all dense estimators here do, and its flow is averaged
over blocks (`gray_detector`). A method that must see the counts themselves derives from
`BlockDetector` instead.
"""

import hashlib
import inspect
import traceback
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from pydantic import field_serializer

from megalopta.core.bounded import quoted
from megalopta.flow.detectors.base import FloatArray
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.gray_detector import DenseDetector, MethodError, PairFlow

DenseFlow: TypeAlias = Callable[[FloatArray, FloatArray], Any]
"""Two frames (H, W) to the flow (H, W, 2) from the first to the second, px, x before y."""


class FunctionDetector(DenseDetector, frozen=True):
    """The flow of a function, averaged over blocks."""

    function: DenseFlow
    """Two frames (H, W), gray levels from 0 to 1, to their flow (H, W, 2)"""

    @field_serializer("function")
    def _identity(self, function: DenseFlow) -> str:
        """Return what tells this function from others, for records and stored results.

        Its source and the values that it encloses; what it calls is not looked into.
        """
        try:
            enclosed = sorted(inspect.getclosurevars(function).nonlocals.items())
            body = f"{inspect.getsource(function)}{enclosed}"
        except (OSError, TypeError):  # built in, or typed into an interpreter
            body = repr(function)
        place = f"{function.__module__}.{getattr(function, '__qualname__', repr(function))}"
        return f"{place} {hashlib.sha256(body.encode()).hexdigest()}"

    def _dense(self, grid: BlockGrid) -> PairFlow:
        return self._answer

    def _answer(self, pair: FloatArray) -> FloatArray:
        try:
            return np.asarray(self.function(pair[0], pair[1]), np.float64)
        except Exception as problem:  # somebody else's code can raise anything
            last = traceback.extract_tb(problem.__traceback__)[-1]
            told = f"{type(problem).__name__}: {' '.join(str(problem).split())}"
            raise MethodError(
                f"method {self.name}: {quoted(told)} at {last.filename}:{last.lineno}; give a "
                "function of two frames (H, W) that returns their flow (H, W, 2)"
            ) from problem


def detector_from(
    function: DenseFlow, name: str | None = None, label: str | None = None
) -> FunctionDetector:
    """Return a detector that asks a function for the flow between neighboring frames.

    Parameters
    ----------
    function
        Two frames (H, W) float64, gray levels from 0 to 1, to their flow (H, W, 2) in px, x before
        y; NaN where undefined.
    name, label : str, optional
        Short name, and name in words; by default the function's.
    """
    short = name or getattr(function, "__name__", type(function).__name__)
    return FunctionDetector(name=short, label=label or short, function=function)
