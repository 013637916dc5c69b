"""Effect of conventions of the benchmark on N_2b of natural scenes.

EMD looks a hundred times worse there because Eq. 4.5 divides by responses near zero. Where
responses have a density at zero, the mean of |ΔR|/|R| has no limit: with denominators floored at ε
it grows as log(1/ε). The `ratio` Σ|ΔR|/Σ|R| has no such pixels.

Frames are scaled to a flux one by one, as in the dissertation, or by their mean, as a camera sees
them; responses are compared with those to the mean counts, or to the light without dark counts.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import chain

import numpy as np
from matplotlib.figure import Figure as Canvas

from megalopta.benchmark.trial import Trial
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.registry import METHODS, THESIS_METHODS
from megalopta.flow.metrics.photon_threshold import format_flux
from megalopta.flow.metrics.response_error import METRICS, Metric
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.flow.stimuli.photons import draw_counts
from megalopta.plotting.picture import Cell, Figure, columns_of
from megalopta.plotting.style import BLACK, BLUE, ORANGE, draw_key, draw_table, log_decades
from megalopta.reproduction.chapter4_curves import SWEEPS, span
from megalopta.reproduction.chapter4_table import PRINTED, SIZE
from megalopta.reproduction.drawing import FigureRecipe, Run, Templates
from megalopta.reproduction.sweep_figure import MeanThreshold, mean_threshold, or_nan, threshold_of

FLUX = 1e7
FLOORS = np.logspace(-7, 0, 29)
"""In units of the mean response"""
_FRAMES, _WARM_UP = 60, 30
_SWEEPS = {"synthetic": "fig-4.8", "natural": "fig-4.11"}
_COLORS = {"synthetic": BLUE, "natural": ORANGE}
_CAPTION = (
    f"Left: error of EMD at {FLUX / 1e6:g} million photons per frame of {SIZE} × {SIZE} px, "
    "with the denominators of Eq. 4.5 floored at a share of the mean response. Right: N_2b at "
    "5 px per frame, by the mean of quotients (Eq. 4.5, filled) and by the quotient of means "
    "(open)."
)


def floored_errors(ideal: Floats, noisy: Floats) -> Floats:
    """Return Eq. 4.5 with denominators of at least each of `FLOORS` mean responses."""
    size, difference = np.abs(ideal).ravel(), np.abs(noisy - ideal).ravel()
    floors = FLOORS * size.mean()
    return np.array([np.mean(difference / np.maximum(size, floor)) for floor in floors])


def _at_five_px(name: str, is_quick: bool) -> list[Trial]:
    """Return the trials of a sweep at 60 × 60 px and 5 px per frame."""
    found = SWEEPS[name].trials
    found = [each for each in found if (each.size, each.velocity_px) == (SIZE, 5)]
    return found[: 2 if is_quick else None]


def _both_kinds(is_quick: bool) -> dict[str, list[Trial]]:
    return {kind: _at_five_px(name, is_quick) for kind, name in _SWEEPS.items()}


def _trials(is_quick: bool) -> list[Trial]:
    return list(chain.from_iterable(_both_kinds(is_quick).values()))


def _denominators(run: Run) -> Figure:
    trials = _both_kinds(run.is_quick)
    curves = {kind: _errors(of_kind[0], run.templates) for kind, of_kind in trials.items()}
    fluxes = {
        (kind, metric, method): mean_threshold(
            [threshold_of(run.results, trial, method, metric, 2) for trial in of_kind]
        ).flux
        for kind, of_kind in trials.items()
        for metric in METRICS
        for method in PRINTED
    }

    factor = fluxes["natural", "literal", "EMD"] / fluxes["natural", "ratio", "EMD"]
    at = np.interp((-4, -3, -2, -1), np.log10(FLOORS), curves["natural"])
    printed = {
        "EMD by Eq. 4.5 over quotient of means, forest": (span([factor]), "—"),
        "Growth of its error per decade of the floor": (span(at[:-1] / at[1:]), "—"),
    }
    return Figure(
        title="Dividing by responses near zero, frames of 60 × 60 px",
        caption=_CAPTION,
        draw=partial(_draw_denominators, curves=curves, fluxes=fluxes),
        numbers=_numbers(curves, fluxes),
        height_in=3.4,
        printed=printed,
    )


def _numbers(
    curves: Mapping[str, Floats], fluxes: Mapping[tuple[str, Metric, str], float]
) -> dict[str, list[Cell]]:
    floored = [
        ("error_of_emd", kind, "EMD", floor, error)
        for kind, errors in curves.items()
        for floor, error in zip(FLOORS.tolist(), errors.tolist(), strict=True)
    ]
    found = [(f"n_2b_{each[1]}", each[0], each[2], np.nan, flux) for each, flux in fluxes.items()]
    names = ("quantity", "images", "method", "floor", "value")
    return columns_of(dict(zip(names, row, strict=True)) for row in (*floored, *found))


def _errors(trial: Trial, templates: Templates) -> Floats:
    stimulus = MovingTemplate(templates[trial.template], trial.velocity_px, trial.size)
    light = stimulus.light(0, _FRAMES)
    detector = METHODS["EMD"]
    counts = draw_counts(light * FLUX, trial.seed, "denominators", trial.template.kind)
    ideal, noisy = (
        detector.scored(detector.respond(frames, scale))[_WARM_UP:]
        for frames, scale in ((light, SIZE**2), (counts, SIZE**2 / FLUX))
    )
    return floored_errors(ideal, noisy)


def _draw_denominators(
    canvas: Canvas,
    curves: Mapping[str, Floats],
    fluxes: Mapping[tuple[str, Metric, str], float],
) -> None:
    floors, axes = canvas.subplots(1, 2)
    for kind, errors in curves.items():
        floors.plot(FLOORS, errors, color=_COLORS[kind], label=kind)
    floors.set_xscale("log")
    log_decades(floors, "y", "{x:g}")
    floors.set(xlabel="Floor (mean responses)", ylabel="Error of EMD, Eq. 4.5")
    floors.legend()
    names = list(PRINTED)
    for (kind, metric, name), flux in fluxes.items():
        color, place = _COLORS[kind], names.index(name) + (-0.12 if kind == "synthetic" else 0.12)
        face = color if metric == "literal" else "none"
        axes.plot(place, flux, "o", color=color, markerfacecolor=face, ms=7)
    draw_key(axes, (("o", BLACK, "mean of quotients"), ("o", "none", "quotient of means")))
    axes.legend(loc="upper left")
    axes.set_xticks(range(len(names)), names)
    log_decades(axes, "y")
    axes.set_ylim(top=100 * np.nanmax(list(fluxes.values())))
    axes.set_ylabel("$N_{2b}$ (photons per frame)")


_HEAD = ("", "Every frame", "Mean frame", "Reference perfect")
_CONVENTIONS: Mapping[str, Mapping[str, str]] = {
    "every frame": {},
    "mean frame": {"normalization": "per_sequence"},
    "perfect sensor": {"reference": "perfect"},
}


def _of_convention(name: str, is_quick: bool) -> list[Trial]:
    """Return the trials of the forests, without motion blur."""
    return [
        trial.model_copy(update={"search": trial.search.model_copy(update=_CONVENTIONS[name])})
        for trial in _at_five_px("fig-4.11", is_quick)
    ]


def _normalizations(run: Run) -> Figure:
    found = {method: _found(method, run) for method in THESIS_METHODS}
    lines = [_line(*each) for each in found.items()]
    return Figure(
        title="Two conventions of the benchmark, natural scenes",
        caption=(
            f"N_2b at 5 px per frame and {SIZE} × {SIZE} px if every frame is scaled to the flux, "
            "as in the dissertation and in Table 4.1, and responses are compared with those to the "
            "mean counts; mean of the forests, with the 95 % CI of a single one. Factors, least to "
            "most of the forests, are for scaling the mean frame to the flux, and for comparison "
            "with the light without dark counts."
        ),
        draw=partial(draw_table, head=_HEAD, rows=lines, widths=(0.8, 1.2, 1.6, 1.9)),
        numbers=columns_of(row for each in found.items() for row in _rows(*each)),
        height_in=2.6,
    )


def _found(method: str, run: Run) -> dict[str, list[MeanThreshold]]:
    """Return the photons that a method needs in each forest, by convention."""
    return {
        name: [
            mean_threshold([threshold_of(run.results, trial, method, "literal", 2)])
            for trial in _of_convention(name, run.is_quick)
        ]
        for name in _CONVENTIONS
    }


def _rows(method: str, found: Mapping[str, Sequence[MeanThreshold]]) -> Iterator[dict[str, Cell]]:
    for name, of_forests in found.items():
        for forest, each in enumerate(of_forests):
            yield {
                "method": method,
                "convention": name,
                "forest": forest,
                "photons_per_frame": each.flux,
                "low": or_nan(each.low),
                "high": or_nan(each.high),
            }


def _line(method: str, found: Mapping[str, Sequence[MeanThreshold]]) -> list[str]:
    every, mean, perfect = (np.array([each.flux for each in own]) for own in found.values())
    own = f"{format_flux(float(every.mean()))} ± {_percent(found['every frame'])}"
    return [method, own, _factors(mean / every), _factors(perfect / every)]


def _percent(found: Sequence[MeanThreshold]) -> str:
    """Return half the width of a typical interval."""
    widths = [(or_nan(each.high) - or_nan(each.low)) / each.flux / 2 for each in found]
    return f"{100 * np.nanmedian(widths):.0f} %"


def _factors(ratios: Floats) -> str:
    known = ratios[np.isfinite(ratios)]
    if not known.size:
        return "–"
    low, high = (f"{value:.2f}" for value in (known.min(), known.max()))
    return f"× {low}" if low == high else f"× {low} to {high}"


RECIPES = (
    FigureRecipe("denominators", _denominators, _trials),
    FigureRecipe(
        "normalizations",
        _normalizations,
        lambda is_quick: [each for name in _CONVENTIONS for each in _of_convention(name, is_quick)],
    ),
)
