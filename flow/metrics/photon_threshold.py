"""Error of a detector over the photon flux, and the flux at which it falls below a level.

N_2b, N_3b, N_4b of the dissertation, §4.3.4: n-bit accuracy is an error of 2⁻ⁿ. The threshold is
the first downward crossing of the measured curve, interpolated linearly in log error over log flux.

Standard errors come from the differences between repeats, independent draws of the same frames, in
independent blocks of frames: (repeats − 1) · blocks degrees of freedom. For the interval of a
threshold the errors are perturbed 2000 times by their relative standard error times Student's t,
and the crossing is found again. It includes neither the variation between scenes nor the error of
interpolation between two fluxes.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field, PositiveInt, TypeAdapter

from megalopta.core.arrays import Floats
from megalopta.core.quantities import number, short
from megalopta.flow.detectors.base import Detector
from megalopta.flow.metrics.response_error import Metric, error_parts, for_json, quotient
from megalopta.sensor.sampling.streams import generator

_REPLICATES = 2000
_TAIL = (1 - 0.95) / 2
_INTERVAL = _TAIL, 1 - _TAIL
_LARGEST_EXPONENT = 50.0
"""Perturbations beyond a factor exp(50) are equal: the error is unknown there."""

Flux = Annotated[float, Field(gt=0, allow_inf_nan=False)]
"""Validated when read from a file"""
Error = Annotated[float, BeforeValidator(lambda value: math.nan if value is None else value)]
"""Undefined errors are None in a file"""


@dataclass(frozen=True)
class Threshold:
    """A flux, or the reason why there is none; prints as "41 200 (39 000 to 43 500)"."""

    kind: Literal["crossing", "above", "below", "undefined"]
    """Kind of curve: it crosses the level, stays above it, starts below it, or does not exist"""
    level: float
    """Error level"""
    range_min: Flux
    """Smallest flux of the curve (photons per frame)"""
    range_max: Flux
    """Largest flux of the curve (photons per frame)"""
    flux: Flux | None = None
    """Flux at which the curve crosses the level (photons per frame)"""
    low: Flux | None = None
    """Lower end of the confidence interval; None: below the curve"""
    high: Flux | None = None
    """Upper end of the confidence interval; None: above the curve"""

    def __str__(self) -> str:
        if self.kind == "undefined" or self.flux is None:
            outside = {"above": f"> {short(self.range_max)}", "below": f"< {short(self.range_min)}"}
            return outside.get(self.kind, "undefined")
        return f"{number(self.flux)} ({self.interval})"

    @property
    def interval(self) -> str:
        """Interval of a crossing: "39 000 to 43 500", or open "39 000 to > 1 billion"."""
        low = f"< {short(self.range_min)}" if self.low is None else number(self.low)
        high = f"> {short(self.range_max)}" if self.high is None else number(self.high)
        return f"{low} to {high}"


def threshold(
    fluxes: ArrayLike,
    errors: ArrayLike,
    standard_errors: ArrayLike,
    degrees_of_freedom: int,
    level: float,
    rng: np.random.Generator,
) -> Threshold:
    """Return the flux at which measured errors (n,) first fall below a level, 0.25 for N_2b.

    Its interval, of 95 %, is drawn from the generator, given the standard errors and their degrees
    of freedom. Raises ValueError if there are fewer than two fluxes or they do not increase.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> errors = [0.8, 0.4, 0.2, 0.1]
    >>> found = threshold([10, 100, 1000, 10_000], errors, np.full(4, 0.01), 30, 0.25, rng)
    >>> [round(flux) for flux in (found.flux, found.low, found.high)]
    [477, 388, 621]
    """
    flux, error, spread = (
        np.asarray(values, np.float64) for values in (fluxes, errors, standard_errors)
    )
    if flux.size < 2 or np.any(np.diff(flux) <= 0):
        raise ValueError(f"fluxes {flux.tolist()}: give two or more, in ascending order")
    bounds = (float(flux[0]), float(flux[-1]))
    if not np.all(np.isfinite(error)):
        return Threshold("undefined", level, *bounds)
    crossing = float(first_crossing(flux, error, level))
    if crossing in (0.0, np.inf):
        return Threshold("above" if crossing else "below", level, *bounds)
    relative = np.divide(spread, error, out=np.zeros_like(error), where=error > 0)
    exponents = relative * rng.standard_t(degrees_of_freedom, (_REPLICATES, error.size))
    replicates = error * np.exp(np.clip(exponents, -_LARGEST_EXPONENT, _LARGEST_EXPONENT))
    low, high = np.quantile(
        first_crossing(flux, replicates, level), _INTERVAL, method="inverted_cdf"
    )
    # On a flat, noisy curve the first of many random crossings is early: keep the estimate.
    low, high = float(min(low, crossing)), float(max(high, crossing))
    interval = low if low > 0 else None, high if high < np.inf else None
    return Threshold("crossing", level, *bounds, crossing, *interval)


def first_crossing(fluxes: Floats, errors: Floats, level: float) -> Floats:
    """Return the first fluxes (n,) at which curves (..., n) fall below a level.

    0 if they start below, infinite if they never do.
    """
    below = errors < level
    after = np.maximum(below.argmax(axis=-1), 1)
    before_error = np.take_along_axis(errors, after[..., np.newaxis] - 1, -1)[..., 0]
    after_error = np.take_along_axis(errors, after[..., np.newaxis], -1)[..., 0]
    log_before = np.log(np.maximum(before_error, level) / level)
    log_after = np.log(np.clip(after_error / level, 1e-3, 1))  # levels; block matching reaches 0
    with np.errstate(invalid="ignore"):
        share = log_before / (log_before - log_after)
    crossing = fluxes[after - 1] * (fluxes[after] / fluxes[after - 1]) ** share
    crossing = np.where(below[..., 0], 0.0, crossing)
    return np.where(below.any(axis=-1), crossing, np.inf)


@dataclass(frozen=True)
class ErrorCurve:
    """Error of one detector over the flux, at one frame size and in one metric."""

    method: str
    shape: tuple[PositiveInt, PositiveInt]
    """Rows and columns of the resized frames"""
    metric: Metric
    fluxes: tuple[Flux, ...]
    """Photons per frame, increasing"""
    errors: tuple[Error, ...]
    """Errors of the whole sequence; NaN if the ideal response is zero everywhere"""
    standard_errors: tuple[Error, ...]
    degrees_of_freedom: int
    """Degrees of freedom of the standard errors"""
    thresholds: dict[int, Threshold]
    """Maps bits n to the flux N_nb at which the error falls below 2⁻ⁿ"""

    def to_dict(self) -> dict[str, Any]:
        """Return the curve ready for JSON; undefined errors are None."""
        thresholds = {f"N_{bits}b": asdict(flux) for bits, flux in self.thresholds.items()}
        return dict(for_json(asdict(self) | {"thresholds": thresholds}))

    @staticmethod
    def from_dict(fields: Mapping[str, Any]) -> "ErrorCurve":
        """Return the curve that `to_dict` wrote.

        Raises ValueError, LookupError, TypeError or AttributeError if something is missing or of
        the wrong kind.
        """
        thresholds = {name[2:-1]: flux for name, flux in fields["thresholds"].items()}
        curve = _READER.validate_python({**fields, "thresholds": thresholds})
        if not len(curve.fluxes) == len(curve.errors) == len(curve.standard_errors):
            raise ValueError(f"errors of {curve.method} are not as many as its fluxes")
        return curve


_READER = TypeAdapter(ErrorCurve)


def error_curve(
    method: Detector,
    shape: tuple[int, int],
    metric: Metric,
    fluxes: Sequence[float],
    sums: Floats,
    block_starts: Sequence[int],
    bits: Sequence[int],
    key: Sequence[str | int],
) -> ErrorCurve:
    """Return the errors of frames (rows, columns) and their thresholds of these bits.

    They are quotients of sums (4, n, repeats, T). `block_starts` are the first frames of
    independent blocks, 0 and others. A key of a seed and names seeds the intervals.
    """
    numerator, denominator = error_parts(sums, metric)
    weight, repeats = denominator.sum(axis=(1, 2)), numerator.shape[1]
    variances = np.add.reduceat(numerator, block_starts, axis=-1).var(axis=1, ddof=1)
    errors = quotient(numerator.sum(axis=(1, 2)), weight)
    spreads = quotient(np.sqrt(repeats * variances.sum(axis=-1)), weight)
    freedom = (repeats - 1) * len(block_starts)
    seed, *names = key
    thresholds = {}
    for n in bits:
        rng = generator(int(seed), "threshold", *names, method.name, metric, n)
        thresholds[n] = threshold(fluxes, errors, spreads, freedom, 2.0**-n, rng)
    return ErrorCurve(
        method=method.name,
        shape=shape,
        metric=metric,
        fluxes=tuple(fluxes),
        errors=tuple(errors.tolist()),
        standard_errors=tuple(spreads.tolist()),
        degrees_of_freedom=freedom,
        thresholds=thresholds,
    )
