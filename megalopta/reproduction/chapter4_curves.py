"""Chapter 4: photons that motion detectors need, over the parameters of §4.4 and §4.5.

`SWEEPS` has every fixed parameter: unless a sweep varies it, contrast 90 %, spatial frequency 5
cycles per frame, 5 px per frame and 0.1 dark counts per pixel and frame. Pooling levels are those
of text or captions. Below each figure are numbers of its curves, with the dissertation's readings
of its own.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from functools import cache, partial
from typing import Any, Literal, NamedTuple

import numpy as np

from megalopta.benchmark.panoramas import NATURAL_PANORAMAS
from megalopta.benchmark.runner import Results
from megalopta.benchmark.trial import PanoramaTemplate, Sweep, Trial, Value
from megalopta.flow.benchmark.settings import SearchSettings
from megalopta.flow.detectors.registry import THESIS_METHODS
from megalopta.flow.metrics.response_error import METRICS
from megalopta.report.text import UNDEFINED
from megalopta.reproduction.picture import Figure
from megalopta.reproduction.sweep_figure import or_nan, sweep_curve, sweep_figure, threshold_of

POOLING = (60, 120, 180, 240)
VELOCITIES = tuple(range(1, 11))
DARK_COUNTS = (0.1, 1.0, 10.0, 100.0, 1000.0)
"""Dark counts per pixel of the template"""

_FIXED = Trial(search=SearchSettings(bits=(2,), phases=3, frames=4))
_NATURAL = _FIXED.model_copy(
    update={"template": PanoramaTemplate(kind="panorama", name=next(iter(NATURAL_PANORAMAS)))}
)


class _Axis(NamedTuple):
    """The varied parameter of a sweep: name, path in a trial, values, and sizes."""

    name: str
    vary: str
    values: tuple[Value, ...]
    sizes: tuple[int, ...] = ()


_FREQUENCY = _Axis("spatial frequency", "template.cycles_per_frame", tuple(range(1, 10)), POOLING)
_CONTRAST = _Axis("contrast", "template.contrast", tuple(n / 10 for n in range(1, 10)), POOLING)
_DARK = _Axis("dark counts", "search.dark_counts", DARK_COUNTS, (240,))
_VELOCITY = _Axis("velocity", "velocity_px", VELOCITIES, (60, 240))
_POOLING = _Axis("spatial pooling", "size", POOLING)


def _gratings(heading: str, axis: _Axis, seen: str = "gratings") -> Sweep:
    """Return a sweep without checks, which would build all its trials."""
    title = f"{heading} needed over {axis.name}, {seen}"
    return Sweep.model_construct(
        title=title, trial=_FIXED, vary=axis.vary, values=axis.values, sizes=axis.sizes
    )


def _forests(
    heading: str,
    axis: _Axis,
    seen: str = "natural scenes",
    blurred: bool = False,
    coding: Literal["linear", "srgb"] = "linear",
) -> Sweep:
    forests = tuple(
        PanoramaTemplate(kind="panorama", name=name, coding=coding) for name in NATURAL_PANORAMAS
    )
    changes = {"templates": forests, "trial": _NATURAL.model_copy(update={"blurred": blurred})}
    return _gratings(heading, axis, seen).model_copy(update=changes)


SWEEPS: Mapping[str, Sweep] = {
    "fig-4.5": _gratings("Figure 4.5: photons", _FREQUENCY),
    "fig-4.6": _gratings("Figure 4.6: photons", _CONTRAST),
    "fig-4.7": _gratings("Figure 4.7: photons", _DARK),
    "fig-4.8": _gratings("Figure 4.8: photons", _VELOCITY),
    "fig-4.9": _gratings("Figure 4.9: photons", _POOLING),
    "fig-4.10": _forests("Figure 4.10: photons", _DARK),
    "fig-4.11": _forests("Figure 4.11: photons", _VELOCITY),
    "fig-4.12": _forests(
        "Figure 4.12: photons", _VELOCITY, "natural scenes with motion blur", blurred=True
    ),
    "fig-4.13": _forests("Figure 4.13: photons", _POOLING),
}

PHOTOGRAPHED = _forests(
    "Photons", _VELOCITY._replace(sizes=(60,)), "photographs of natural scenes", coding="srgb"
)
"""The dissertation's panoramas are web pictures, whose gray values are not linear in light."""


@cache
def in_form(sweep: Sweep, is_quick: bool) -> Sweep:
    """Return a sweep, in quick form with the smallest frames, every third value and two forests."""
    if not is_quick:
        return sweep
    changes: dict[str, Any] = {"templates": sweep.templates[:2]}
    if sweep.vary == "size":
        changes |= {"values": sweep.values[:2]}
    else:
        changes |= {"values": sweep.values[::3], "sizes": POOLING[:1]}
    return sweep.model_copy(update=changes)


MOTION = tuple(name for name in THESIS_METHODS if name != "IM")


class CurveQuantity(NamedTuple):
    """A number of a figure's curves: name, computation, and printed value."""

    name: str
    values: Callable[[Sweep, Results], Iterable[float]]
    """Returns one value per method and size; NaN if not measured"""
    printed: str = "—"


def curve(sweep: Sweep, results: Results, method: str, size: int = 0) -> Mapping[float, float]:
    """Return N_2b by Eq. 4.5 over the varied parameter, where defined, at one size."""
    found = sweep_curve(sweep, results, size, method, "literal")
    return {float(value): threshold.flux for value, threshold in found if threshold.flux > 0}


def decades_moved(*methods: str) -> Callable[[Sweep, Results], list[float]]:
    """Return the range of curves of methods in decades, at each size."""

    def moved(sweep: Sweep, results: Results) -> list[float]:
        curves = [curve(sweep, results, name, size) for name in methods for size in sweep.sizes]
        return [math.log10(_spread(each)) for each in curves]

    return moved


def exponents(sweep: Sweep, results: Results, places: tuple[int, int] = (0, -1)) -> list[float]:
    """Return the exponent of photons between two values, by default the ends, for all detectors."""
    low, high = (float(sweep.values[place]) for place in places)
    curves = (curve(sweep, results, name, size) for name in MOTION for size in sweep.sizes)
    return [math.log(_at(each, high) / _at(each, low)) / math.log(high / low) for each in curves]


def spike_of_block_matching(sweep: Sweep, results: Results) -> list[float]:
    """Return photons of BM halfway between whole pixels over those at whole pixels, at N = 60."""
    photons = curve(sweep, results, "BM", 60)
    return [_at(photons, 6) / max(_at(photons, 5), _at(photons, 7))]


def spread_of_interpolation(sweep: Sweep, results: Results) -> list[float]:
    """Return most over least photons of IIA at N = 240."""
    return [_spread(curve(sweep, results, "IIA", 240)) if 240 in sweep.sizes else math.nan]


def interpolation_beside_one_pixel(sweep: Sweep, results: Results) -> list[float]:
    """Return photons of IIA at the median velocity over those at nearly one pooled pixel."""
    photons = curve(sweep, results, "IIA", 60)
    others = [flux for velocity, flux in photons.items() if velocity != 4]
    return [float(np.median(others)) / _at(photons, 4) if others else math.nan]


def pooling_of_block_matching(sweep: Sweep, results: Results) -> list[float]:
    """Return photons of BM in the largest frames over those in the smallest."""
    photons = curve(sweep, results, "BM")
    few, many = float(sweep.values[0]), float(sweep.values[-1])
    return [_at(photons, many) / _at(photons, few)]


def division_by_small_responses(sweep: Sweep, results: Results) -> list[float]:
    """Return photons of EMD by Eq. 4.5 over those by the quotient of means, the median point."""
    literal, ratio = (
        [or_nan(threshold_of(results, each, "EMD", metric, 2).flux) for each in sweep.trials]
        for metric in METRICS
    )
    quotients = np.array(literal) / np.array(ratio)
    known = quotients[np.isfinite(quotients)]
    return [float(np.median(known)) if known.size else math.nan]


_DIVISION = CurveQuantity("EMD by Eq. 4.5 over quotient of means", division_by_small_responses)
_LAST_EXPONENT = CurveQuantity(
    "Last exponent of dark counts, motion detectors", partial(exponents, places=(-2, -1))
)
_LARGEST_FRAMES = CurveQuantity(
    "BM: largest over smallest frames", pooling_of_block_matching, "1 or less"
)

QUANTITIES: Mapping[str, tuple[CurveQuantity, ...]] = {
    "fig-4.5": (
        CurveQuantity("Decades that EMD moves", decades_moved("EMD"), "two to three"),
        CurveQuantity("Decades that IIA moves", decades_moved("IIA"), "about two"),
        CurveQuantity("Decades that NDM and NDS move", decades_moved("NDM", "NDS"), "one"),
    ),
    "fig-4.6": (
        CurveQuantity("Exponent of contrast, motion detectors", exponents, "−1.7, 10 to 20 %"),
    ),
    "fig-4.7": (_LAST_EXPONENT,),
    "fig-4.8": (
        CurveQuantity(
            "BM at 1.43 px per resized frame over beside", spike_of_block_matching, "a spike"
        ),
        CurveQuantity("IIA at N = 240, most over least", spread_of_interpolation, "flat"),
    ),
    "fig-4.9": (_LARGEST_FRAMES,),
    "fig-4.10": (_DIVISION, _LAST_EXPONENT),
    "fig-4.11": (
        _DIVISION,
        CurveQuantity("IIA, median velocity over v = 4", interpolation_beside_one_pixel),
    ),
    "fig-4.12": (_DIVISION,),
    "fig-4.13": (_LARGEST_FRAMES, _DIVISION),
}


def beside_printed(name: str, sweep: Sweep, results: Results) -> dict[str, tuple[str, str]]:
    """Return numbers of a figure with the printed ones, if measured."""
    found = {each: span(each.values(sweep, results)) for each in QUANTITIES.get(name, ())}
    return {each.name: (text, each.printed) for each, text in found.items() if text != UNDEFINED}


def span(values: Iterable[float]) -> str:
    """Format the least and the most of values with two digits; a dash if one is unknown."""
    found = list(values)
    if not found or not np.isfinite(found).all():
        return UNDEFINED
    low, high = (f"{value:.2g}".replace("-", "−") for value in (min(found), max(found)))
    return low if low == high else f"{low} to {high}"


def _at(photons: Mapping[float, float], value: float) -> float:
    return photons.get(value, math.nan)


def _spread(photons: Mapping[float, float]) -> float:
    return max(photons.values()) / min(photons.values()) if len(photons) > 1 else math.nan


def curve_figure(name: str, results: Results, is_quick: bool) -> Figure:
    """Return a figure of `SWEEPS`."""
    sweep = in_form(SWEEPS[name], is_quick)
    return sweep_figure(name, sweep, results, beside_printed(name, sweep, results))
