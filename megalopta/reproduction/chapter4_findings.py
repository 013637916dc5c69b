"""What a run of Chapter 4 shows, in sentences.

A finding is a function of a sweep and its results. It returns its sentence where the numbers of
this run bear it out, and None where they do not, or where the run did not measure what it is about.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from megalopta.benchmark.runner import Results
from megalopta.benchmark.sweep import Sweep
from megalopta.flow.detectors.registry import THESIS_METHODS
from megalopta.flow.metrics.response_error import METRICS
from megalopta.plotting.picture import borne_out
from megalopta.reproduction.thresholds import sweep_curve, threshold_of

Finding: TypeAlias = Callable[[Sweep, Results], str | None]
Curve: TypeAlias = Mapping[float, float]
"""Value of the varied parameter to photons per frame, where there is a threshold"""

MOTION = tuple(name for name in THESIS_METHODS if name != "IM")
_LARGE = 10.0
"""A quotient of photons that counts as another order of magnitude"""


def findings(name: str, sweep: Sweep, results: Results) -> tuple[str, ...]:
    """Return what the results of a figure bear out."""
    return borne_out(*(finding(sweep, results) for finding in FINDINGS.get(name, ())))


def curve(sweep: Sweep, results: Results, method: str, size: int = 0) -> Curve:
    """Return N_2b by Eq. 4.5 over the varied parameter, at one size unless that is varied."""
    found = sweep_curve(sweep, results, size, method, "literal")
    return {float(value): threshold.flux for value, threshold in found if threshold.flux > 0}


def decades(photons: Curve) -> float:
    """Return how far a curve moves; NaN for less than two points."""
    return math.log10(_spread(photons)) if len(photons) > 1 else math.nan


def exponent(photons: Curve, low: float, high: float) -> float:
    """Return the power with which photons go between two values; NaN where either is missing."""
    if not {low, high} <= photons.keys():
        return math.nan
    return math.log(photons[high] / photons[low]) / math.log(high / low)


def widely_over_frequency(sweep: Sweep, results: Results) -> str | None:
    """EMD moves by two to three decades and IIA by two."""
    emd, iia = (_moved(sweep, results, name) for name in ("EMD", "IIA"))
    if not all(1.5 < each < 3.5 for each in emd) or not all(1.5 < each < 2.5 for each in iia):
        return None
    return (
        f"As in the dissertation, EMD moves by two to three decades (ours: {_span(emd)}) and IIA by"
        f" about two ({_span(iia)})."
    )


def nonlinear_over_frequency(sweep: Sweep, results: Results) -> str | None:
    """NDM and NDS move by more than the decade that is printed."""
    moved = _moved(sweep, results, "NDM") + _moved(sweep, results, "NDS")
    if not all(each > 1.05 for each in moved):
        return None
    return (
        f"NDM and NDS move by {_span(moved)} decades, more than the one that the dissertation reads"
        " off."
    )


def inverse_square_of_contrast(sweep: Sweep, results: Results) -> str | None:
    """Motion detectors need photons as C⁻²."""
    ends = float(sweep.values[0]), float(sweep.values[-1])
    curves = (curve(sweep, results, name, size) for name in MOTION for size in sweep.sizes)
    found = [exponent(photons, *ends) for photons in curves]
    if not all(-2.3 < each < -1.7 for each in found):
        return None
    return (
        f"All motion detectors need photons nearly as C⁻² (exponent {_span(found)}), 0.6 decades "
        "from 10 to 20 %, where the dissertation reads off about 0.5."
    )


def towards_root_of_dark_counts(sweep: Sweep, results: Results) -> str | None:
    """N_2b of the motion detectors rises ever more steeply, towards the root of dark counts."""
    counts = [float(value) for value in sweep.values]
    curves = (curve(sweep, results, name, size) for name in MOTION for size in sweep.sizes)
    rises = [[exponent(photons, *pair) for pair in pairwise(counts)] for photons in curves]
    last = [each[-1] for each in rises if each]
    is_steeper = all(sorted(each) == each for each in rises)
    if len(counts) < 3 or not is_steeper or not all(0.1 < each < 0.6 for each in last):
        return None
    return (
        "N_2b of the motion detectors rises ever more steeply with the dark counts, towards their "
        f"square root: at the end with an exponent of {_span(last)}."
    )


def brightness_of_dark_counts(sweep: Sweep, results: Results) -> str | None:
    """IM has no N_2b where dark counts alone tell it the brightness of a pixel."""
    most = sweep.values[-1]
    at_most = [point.trial for point in sweep.points if point.value == most]
    if any(threshold_of(results, each, "IM", "literal", 2).kind != "below" for each in at_most):
        return None
    return f"At {most:g} dark counts IM has no N_2b: they alone tell it the brightness of a pixel."


def spike_of_block_matching(sweep: Sweep, results: Results) -> str | None:
    """At N = 60 BM needs most where the motion is half way between whole pixels."""
    if 60 not in sweep.sizes:
        return None
    photons = curve(sweep, results, "BM", 60)
    if not {5, 6, 7} <= photons.keys() or photons[6] < 1.5 * max(photons[5], photons[7]):
        return None
    return (
        "The spike of BM at N = 60 is at 1.43 px per resized frame, half way between one whole "
        "pixel and two."
    )


def flat_interpolation(sweep: Sweep, results: Results) -> str | None:
    """IIA is flat over velocity at N = 240."""
    if 240 not in sweep.sizes:
        return None
    photons = curve(sweep, results, "IIA", 240)
    if len(photons) < len(sweep.values) or _spread(photons) > 3:
        return None
    return (
        f"IIA is flat at N = 240, within a factor of {_spread(photons):.2f}: noise in its "
        "gradients shrinks every velocity by the same factor."
    )


def interpolation_at_one_pixel(sweep: Sweep, results: Results) -> str | None:
    """IIA needs least where the shift is nearly one pixel of the resized frames."""
    photons = curve(sweep, results, "IIA", 60)
    others = [flux for velocity, flux in photons.items() if velocity != 4]
    if 4 not in photons or not others:
        return None
    factor = float(np.median(others)) / photons[4]
    if factor < 3:
        return None
    return (
        "IIA has its least at v = 4, nearly one pixel per frame of 60 × 60 px, and needs "
        f"{_rounded(factor, 2)} times as many photons at the median of the other velocities."
    )


def rest_of_block_matching(sweep: Sweep, results: Results) -> str | None:
    """BM has no point at low velocities, where it reads rest in most clean blocks."""
    slowest = float(min(map(float, sweep.values)))
    of_slowest = [point.trial for point in sweep.points if point.value == slowest]
    kinds = {threshold_of(results, each, "BM", "literal", 2).kind for each in of_slowest}
    if "undefined" not in kinds:
        return None
    return (
        f"BM has no point at v = {slowest:g} where it reads rest in most blocks of the clean "
        "frames, for its error is 0/0 there."
    )


def pooling_of_block_matching(sweep: Sweep, results: Results) -> str | None:
    """BM gains from fewer, larger pixels or not; in the dissertation it does not."""
    photons = curve(sweep, results, "BM")
    few, many = (float(sweep.values[0]), float(sweep.values[-1]))
    if not {few, many} <= photons.keys():
        return None
    gain = photons[many] / photons[few]
    pixels = f"{few:g} × {few:g} px than of {many:g} × {many:g} px"
    if gain > 1.2:
        return (
            f"BM needs {gain:.1f} times fewer photons in frames of {pixels}, while in the "
            "dissertation it stays flat or worsens a little."
        )
    if gain < 1:
        return f"As in the dissertation, BM needs no fewer photons in frames of {pixels}."
    return None


def division_by_small_responses(sweep: Sweep, results: Results) -> str | None:
    """By Eq. 4.5 EMD needs many times the photons that it needs by the quotient of means."""
    quotients = []
    for point in sweep.points:
        literal, ratio = (
            threshold_of(results, point.trial, "EMD", metric, 2).flux for metric in METRICS
        )
        if literal and ratio:
            quotients.append(literal / ratio)
    return division_sentence(float(np.median(quotients))) if quotients else None


def division_sentence(factor: float) -> str | None:
    """Say how much more EMD needs by Eq. 4.5, if it is another order of magnitude."""
    if not factor > _LARGE:
        return None
    return (
        f"By the quotient of means EMD needs about {_rounded(factor, 1)} times fewer photons on "
        "natural scenes: Eq. 4.5 divides by its responses near zero."
    )


FINDINGS: Mapping[str, tuple[Finding, ...]] = {
    "fig-4.5": (widely_over_frequency, nonlinear_over_frequency),
    "fig-4.6": (inverse_square_of_contrast,),
    "fig-4.7": (towards_root_of_dark_counts, brightness_of_dark_counts),
    "fig-4.8": (spike_of_block_matching, flat_interpolation, rest_of_block_matching),
    "fig-4.9": (pooling_of_block_matching,),
    "fig-4.10": (division_by_small_responses, towards_root_of_dark_counts),
    "fig-4.11": (
        division_by_small_responses,
        interpolation_at_one_pixel,
        rest_of_block_matching,
    ),
    "fig-4.12": (division_by_small_responses, rest_of_block_matching),
    "fig-4.13": (pooling_of_block_matching, division_by_small_responses),
}
"""By name of a figure; its caption has the first that holds, its page all."""


def _moved(sweep: Sweep, results: Results, method: str) -> list[float]:
    """Decades by which a method moves, at each size."""
    return [decades(curve(sweep, results, method, size)) for size in sweep.sizes]


def _spread(photons: Curve) -> float:
    return max(photons.values()) / min(photons.values())


def _span(values: Sequence[float]) -> str:
    low, high = (f"{value:.1f}".replace("-", "−") for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _rounded(factor: float, digits: int) -> str:
    return f"{float(f'{factor:.{digits}g}'):g}"
