"""The error of a detector over the photon flux, its standard errors, and where it crosses.

The standard error of an error comes from the differences between the repeats, which are
independent draws of the same frames. It is estimated in blocks of frames that vary independently of
each other and added up over the blocks: (repeats − 1) · blocks degrees of freedom.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import numpy as np
from pydantic import PositiveInt, TypeAdapter

from megalopta.flow.detectors.base import Detector, FloatArray
from megalopta.flow.metrics.photon_threshold import Flux, Threshold, threshold
from megalopta.flow.metrics.response_error import ErrorSums, Metric, quotient
from megalopta.sensor.sampling.streams import generator


@dataclass(frozen=True)
class ErrorCurve:
    """Error of one detector over the flux, at one frame size and in one metric."""

    method: str
    label: str
    shape: tuple[PositiveInt, PositiveInt]
    """Rows and columns of the resized frames"""

    metric: Metric
    fluxes: tuple[Flux, ...]
    """Photons per frame, growing"""

    errors: tuple[float, ...]
    """Of the whole sequence; NaN when the ideal response is zero everywhere"""

    standard_errors: tuple[float, ...]
    degrees_of_freedom: int
    """Of the standard errors"""

    thresholds: dict[int, Threshold]
    """Bits n to the flux N_nb at which the error falls below 2⁻ⁿ"""

    def to_dict(self) -> dict[str, Any]:
        """Return the curve ready for JSON; undefined errors are None."""
        fields = asdict(self)
        for name in ("errors", "standard_errors"):
            fields[name] = [None if math.isnan(value) else value for value in fields[name]]
        fields["thresholds"] = {f"N_{bits}b": each for bits, each in fields["thresholds"].items()}
        return fields

    @staticmethod
    def from_dict(fields: Mapping[str, Any]) -> "ErrorCurve":
        """Return the curve that `to_dict` wrote.

        Raises
        ------
        ValueError, LookupError, TypeError, AttributeError
            When something lacks, or is nothing of the kind.
        """
        errors = {
            name: [math.nan if value is None else value for value in fields[name]]
            for name in ("errors", "standard_errors")
        }
        thresholds = {
            name.removeprefix("N_").removesuffix("b"): each
            for name, each in fields["thresholds"].items()
        }
        curve = _reader().validate_python({**fields, **errors, "thresholds": thresholds})
        if not len(curve.fluxes) == len(curve.errors) == len(curve.standard_errors):
            raise ValueError(f"errors of {curve.method} are not as many as its fluxes")
        return curve


@cache
def _reader() -> TypeAdapter[ErrorCurve]:
    """Made once, which takes as long as reading many curves."""
    return TypeAdapter(ErrorCurve)


def error_curve(
    method: Detector,
    shape: tuple[int, int],
    metric: Metric,
    fluxes: Sequence[float],
    sums: ErrorSums,
    block_starts: Sequence[int],
    bits: Sequence[int],
    confidence: float,
    seed: int,
    *key: str | int,
) -> ErrorCurve:
    """Return a curve and its thresholds.

    Parameters
    ----------
    method
    shape
        Rows and columns of the frames.
    metric
    fluxes : (n,)
        Photons per frame, growing.
    sums : (n, repeats, T)
        Of the scored frames.
    block_starts
        Frames at which blocks begin that vary independently of each other; the first is 0.
    bits
        Accuracies whose flux is wanted, n bits being an error of 2⁻ⁿ.
    confidence : float
        Probability that an interval holds.
    seed, *key
        Name the random numbers of the intervals, together with method, metric and bits.
    """
    numerator, denominator = sums.parts(metric)
    weight = denominator.sum(axis=(1, 2))
    errors = quotient(numerator.sum(axis=(1, 2)), weight)
    spread, degrees = _spread_of_sum(numerator, block_starts)
    standard_errors = quotient(spread, weight)
    thresholds = {}
    for each in bits:
        rng = generator(seed, "threshold", *key, method.name, metric, each)
        thresholds[each] = threshold(
            fluxes, errors, standard_errors, degrees, 2.0**-each, rng, confidence
        )
    return ErrorCurve(
        method=method.name,
        label=method.label,
        shape=shape,
        metric=metric,
        fluxes=tuple(fluxes),
        errors=tuple(errors.tolist()),
        standard_errors=tuple(standard_errors.tolist()),
        degrees_of_freedom=degrees,
        thresholds=thresholds,
    )


def _spread_of_sum(values: FloatArray, block_starts: Sequence[int]) -> tuple[FloatArray, int]:
    """Return the standard deviation of Σ over repeats and frames, and its degrees of freedom.

    Parameters
    ----------
    values : (fluxes, repeats, T)
    block_starts
        As in `error_curve`.
    """
    repeats = values.shape[1]
    variances = np.add.reduceat(values, block_starts, axis=-1).var(axis=1, ddof=1)
    return np.sqrt(repeats * variances.sum(axis=-1)), (repeats - 1) * len(block_starts)
