"""Effect of two conventions of the benchmark on N_2b of natural scenes.

Frames are brought to a flux one by one, as in the dissertation, or by their mean, as a camera sees
them; responses are compared with those to the mean counts, or to the light without dark counts.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure as Canvas

from megalopta.benchmark.trial import Trial
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.registry import THESIS_METHODS
from megalopta.flow.metrics.photon_threshold import format_flux
from megalopta.plotting.picture import Cell, Figure, columns_of
from megalopta.plotting.style import draw_table
from megalopta.reproduction.chapter4_sweeps import SWEEPS
from megalopta.reproduction.chapter4_table import SIZE
from megalopta.reproduction.figure_recipe import FigureRecipe, Run
from megalopta.reproduction.sweep_figure import (
    MeanThreshold,
    mean_threshold,
    or_nan,
    threshold_of,
)

_CONVENTIONS: Mapping[str, Mapping[str, str]] = {
    "every frame": {},
    "mean frame": {"normalization": "per_sequence"},
    "perfect sensor": {"reference": "perfect"},
}


def _of_convention(name: str, is_quick: bool) -> list[Trial]:
    """The trials of the forests at 60 × 60 px and 5 px per frame, without motion blur."""
    forests = [
        trial for trial in SWEEPS["fig-4.11"].trials if (trial.size, trial.velocity_px) == (SIZE, 5)
    ]
    return [
        trial.model_copy(update={"search": trial.search.model_copy(update=_CONVENTIONS[name])})
        for trial in forests[: 2 if is_quick else None]
    ]


def _trials(is_quick: bool) -> list[Trial]:
    return [trial for name in _CONVENTIONS for trial in _of_convention(name, is_quick)]


def _figure(run: Run) -> Figure:
    found = {method: _found(method, run) for method in THESIS_METHODS}
    return Figure(
        title="Two conventions of the benchmark, natural scenes",
        caption=(
            f"N_2b at 5 px per frame and {SIZE} × {SIZE} px when every frame is brought to the "
            "flux, as in the dissertation and in Table 4.1, and responses are compared with those "
            "to the mean counts; the mean of the forests, with the 95 % interval of a single one. "
            "The factors, least to most of the forests, are those of bringing the mean frame to "
            "the flux, and of comparing with the light without dark counts."
        ),
        draw=partial(_draw, lines=[_line(*each) for each in found.items()]),
        numbers=columns_of(row for each in found.items() for row in _rows(*each)),
        height_in=2.6,
    )


def _found(method: str, run: Run) -> dict[str, list[MeanThreshold]]:
    """Return what a method needs of each forest, by convention."""
    return {
        name: [
            mean_threshold([threshold_of(run.results, trial, method, "literal", 2)])
            for trial in _of_convention(name, run.is_quick)
        ]
        for name in _CONVENTIONS
    }


def _draw(canvas: Canvas, lines: Sequence[Sequence[str]]) -> None:
    head = ["", "Every frame", "Mean frame", "Reference perfect"]
    draw_table(canvas, head, lines, [0.8, 1.2, 1.6, 1.9])


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
    """Return half a typical interval."""
    widths = [(or_nan(each.high) - or_nan(each.low)) / each.flux / 2 for each in found]
    return f"{100 * np.nanmedian(widths):.0f} %"


def _factors(ratios: Floats) -> str:
    known = ratios[np.isfinite(ratios)]
    if not known.size:
        return "–"
    low, high = (f"{value:.2f}" for value in (known.min(), known.max()))
    return f"× {low}" if low == high else f"× {low} to {high}"


RECIPES = (FigureRecipe("normalizations", _figure, _trials),)
