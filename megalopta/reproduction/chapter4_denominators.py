"""Why EMD looks a hundred times worse on natural scenes: Eq. 4.5 divides by responses near zero.

Where responses have a density at zero, the mean of |ΔR|/|R| has no limit: with denominators floored
at ε it grows as log(1/ε). The `ratio` Σ|ΔR|/Σ|R| has no such pixels.
"""

from collections.abc import Mapping
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from megalopta.benchmark.trial import Trial
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.response_error import METRICS, Metric
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.flow.stimuli.photons import draw_counts
from megalopta.plotting.picture import Cell, Figure
from megalopta.plotting.style import BLACK, BLUE, ORANGE, draw_key, log_decades
from megalopta.reproduction.chapter4_curves import span
from megalopta.reproduction.chapter4_sweeps import SWEEPS
from megalopta.reproduction.chapter4_table import PRINTED, SIZE
from megalopta.reproduction.figure_recipe import FigureRecipe, Run, Templates
from megalopta.reproduction.sweep_figure import mean_threshold, threshold_of

FLUX = 1e7
FLOORS = np.logspace(-7, 0, 29)
"""In mean responses"""
_FRAMES, _WARM_UP = 60, 30
_COLORS = {"synthetic": BLUE, "natural": ORANGE}
_CAPTION = (
    f"The left panel has the error of EMD at {FLUX / 1e6:g} million photons per frame of "
    f"{SIZE} × {SIZE} px, with the denominators of Eq. 4.5 floored at a share of the mean "
    "response. The right one has N_2b at 5 px per frame, by the mean of quotients (Eq. 4.5, "
    "filled) and by the quotient of means (open)."
)


def floored_errors(ideal: Floats, noisy: Floats) -> Floats:
    """Return Eq. 4.5 with denominators of at least each of `FLOORS` mean responses."""
    size, difference = np.abs(ideal).ravel(), np.abs(noisy - ideal).ravel()
    floors = FLOORS * size.mean()
    return np.array([np.mean(difference / np.maximum(size, floor)) for floor in floors])


def _at_five_px(is_quick: bool) -> dict[str, list[Trial]]:
    """The trials of 60 × 60 px and 5 px per frame: of the grating, and of the forests."""
    return {
        kind: [
            trial for trial in SWEEPS[name].trials if (trial.size, trial.velocity_px) == (SIZE, 5)
        ][: 2 if is_quick else None]
        for kind, name in (("synthetic", "fig-4.8"), ("natural", "fig-4.11"))
    }


def _trials(is_quick: bool) -> list[Trial]:
    return [trial for trials in _at_five_px(is_quick).values() for trial in trials]


def _figure(run: Run) -> Figure:
    trials = _at_five_px(run.is_quick)
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
        draw=partial(_draw, curves=curves, fluxes=fluxes),
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
    found_at = [
        (f"n_2b_{metric}", kind, name, np.nan, flux)
        for (kind, metric, name), flux in fluxes.items()
    ]
    names = ("quantity", "images", "method", "floor", "value")
    columns = zip(*floored, *found_at, strict=True)
    return {name: list(column) for name, column in zip(names, columns, strict=True)}


def _draw(
    canvas: Canvas,
    curves: Mapping[str, Floats],
    fluxes: Mapping[tuple[str, Metric, str], float],
) -> None:
    left, right = canvas.subplots(1, 2)
    _draw_floors(left, curves)
    _draw_fluxes(right, fluxes)


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


def _draw_floors(axes: Axes, curves: Mapping[str, Floats]) -> None:
    for kind, errors in curves.items():
        axes.plot(FLOORS, errors, color=_COLORS[kind], label=kind)
    axes.set_xscale("log")
    log_decades(axes, "y", "{x:g}")
    axes.set(xlabel="Floor (mean responses)", ylabel="Error of EMD, Eq. 4.5")
    axes.legend()


def _draw_fluxes(axes: Axes, fluxes: Mapping[tuple[str, Metric, str], float]) -> None:
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


RECIPES = (FigureRecipe("denominators", _figure, _trials),)
