"""Chapter 4: the photons that motion detectors need, over the parameters of §4.4 and §4.5."""

from dataclasses import replace

from megalopta.experiments import SWEEPS, Results, Trial, in_form
from megalopta.figures import Figure, Planned, PlannedRegistry, Templates, sweep_figure
from megalopta.figures.chapter4.denominators import DENOMINATORS
from megalopta.figures.chapter4.findings import findings
from megalopta.figures.chapter4.information import NATURAL_INFORMATION
from megalopta.figures.chapter4.table import TABLE_4_1
from megalopta.figures.chapter4.times import TABLE_TIMES


def _planned_sweep(name: str) -> Planned:
    def trials(is_quick: bool) -> list[Trial]:
        return in_form(SWEEPS[name], is_quick).trials

    def figure(is_quick: bool, results: Results, templates: Templates) -> Figure:
        sweep = in_form(SWEEPS[name], is_quick)
        return sweep_figure(name, sweep, results, findings(name, sweep, results))

    return Planned(trials, figure)


def _marked(plan: Planned) -> Planned:
    """Return a plan whose quick form says so, in title and numbers."""

    def figure(is_quick: bool, results: Results, templates: Templates) -> Figure:
        made = plan.figure(is_quick, results, templates)
        if not is_quick:
            return made
        title = f"{made.title} (quick form)"
        return replace(made, title=title, details={**made.details, "quick": True})

    return Planned(plan.trials, figure)


CHAPTER_4: PlannedRegistry = {
    **{name: _marked(_planned_sweep(name)) for name in SWEEPS},
    "table-4.1": _marked(TABLE_4_1),
    "table-4.times": TABLE_TIMES,
    "denominators": _marked(DENOMINATORS),
    "natural-information": _marked(NATURAL_INFORMATION),
}
