"""Chapter 4: the photons that motion detectors need, over the parameters of §4.4 and §4.5."""

from functools import partial

from megalopta.benchmark.trial import Trial
from megalopta.plotting.picture import Figure
from megalopta.reproduction.chapter4_findings import findings
from megalopta.reproduction.chapter4_sweeps import SWEEPS, in_form
from megalopta.reproduction.recipe import FigureRecipe, Run
from megalopta.reproduction.sweep import sweep_figure


def _trials(name: str, is_quick: bool) -> list[Trial]:
    return in_form(SWEEPS[name], is_quick).trials


def _figure(name: str, run: Run) -> Figure:
    sweep = in_form(SWEEPS[name], run.is_quick)
    return sweep_figure(name, sweep, run.results, findings(name, sweep, run.results))


RECIPES = [FigureRecipe(name, partial(_figure, name), partial(_trials, name)) for name in SWEEPS]
