"""What detectors need: N_2b over templates, in one trial, and along a sweep."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from megalopta.benchmark.runner import Results
from megalopta.benchmark.sweep import Sweep, Value
from megalopta.benchmark.trial import Trial
from megalopta.flow.metrics.photon_threshold import Threshold, format_flux
from megalopta.flow.metrics.response_error import Metric


class MeanThreshold(NamedTuple):
    """Photons per frame at one value of a sweep; NaN where not all templates have a threshold.

    Of one template the bounds are its confidence interval, of several the least and the most. An
    end at which the interval is open, beyond the curve, is None.
    """

    flux: float
    low: float | None
    high: float | None
    interval: str
    """The bounds in print"""


def mean_threshold(thresholds: Sequence[Threshold]) -> MeanThreshold:
    """Return the mean over templates, and bounds."""
    if any(each.flux is None for each in thresholds):
        return MeanThreshold(math.nan, math.nan, math.nan, "")
    fluxes = [float(each.flux or math.nan) for each in thresholds]
    if len(fluxes) > 1:
        low, high = min(fluxes), max(fluxes)
        interval = f"[{format_flux(low)}, {format_flux(high)}]"
        return MeanThreshold(float(np.mean(fluxes)), low, high, interval)
    (only,) = thresholds
    return MeanThreshold(fluxes[0], only.low, only.high, only.interval)


def threshold_of(
    results: Results, trial: Trial, method: str, metric: Metric, bits: int
) -> Threshold:
    """Return what one detector needs in one trial."""
    for curve in results[trial]:
        if (curve.method, curve.metric) == (method, metric):
            return curve.thresholds[bits]
    raise KeyError(f"{method}, {metric}")


def sweep_curve(
    sweep: Sweep, results: Results, size: int, method: str, metric: Metric, bits: int = 2
) -> list[tuple[Value, MeanThreshold]]:
    """Return what one detector needs at each value of a sweep, at one size."""
    at_value: dict[Value, list[Threshold]] = {}
    for point in sweep.points:
        if sweep.vary == "size" or point.size == size:
            found = threshold_of(results, point.trial, method, metric, bits)
            at_value.setdefault(point.value, []).append(found)
    return [(value, mean_threshold(thresholds)) for value, thresholds in at_value.items()]


def or_nan(flux: float | None) -> float:
    """Return a flux or bound as a number; NaN where there is none, or none on that side."""
    return math.nan if flux is None else flux
