"""Chapter 4: the photons that motion detectors need, over the parameters of §4.4 and §4.5."""

from collections.abc import Mapping
from dataclasses import replace

from megalopta.chapter4_sweeps import SWEEPS, in_form
from megalopta.engine import Results
from megalopta.figure import Figure
from megalopta.figures_chapter4_denominators import DENOMINATORS
from megalopta.figures_chapter4_information import NATURAL_INFORMATION
from megalopta.figures_chapter4_table import TABLE_4_1
from megalopta.figures_chapter4_times import TABLE_TIMES
from megalopta.figures_sweep import sweep_figure
from megalopta.planned import Planned, PlannedRegistry, Templates
from megalopta.trial import Trial

_GRATING = "N_2b: flux at which the error of Eq. 4.5 is 25 %, with 95 % intervals. Gratings (rot)."
_FOREST = (
    "N_2b: flux at which the error of Eq. 4.5 is 25 %. Mean over the rendered forests; bars: "
    "least and most. That of EMD and IIA rests on a few answers near zero: their order of "
    "magnitude counts."
)
_GAPS = "No BM where its answer to most of the clean blocks is rest."

_CONDITIONS: Mapping[str, str] = {
    "fig-4.5": f"{_GRATING} C = 90 %, 5 px per frame, 0.1 dark counts per pixel.",
    "fig-4.6": f"{_GRATING} f = 5, 5 px per frame, 0.1 dark counts per pixel.",
    "fig-4.7": (
        f"{_GRATING} f = 5, C = 90 %, 5 px per frame. Dark counts are per pixel of the 251 × 251 "
        "frame."
    ),
    "fig-4.8": f"{_GRATING} f = 5, C = 90 %, 0.1 dark counts per pixel. {_GAPS}",
    "fig-4.9": f"{_GRATING} f = 5, C = 90 %, 5 px per frame, 0.1 dark counts per pixel.",
    "fig-4.10": f"{_FOREST} 5 px per frame. Dark counts are per pixel of the 251 × 251 frame.",
    "fig-4.11": f"{_FOREST} 0.1 dark counts per pixel. {_GAPS}",
    "fig-4.12": (
        f"{_FOREST} 0.1 dark counts per pixel; the motion within a frame smears it over v px."
        f" {_GAPS}"
    ),
    "fig-4.13": f"{_FOREST} 5 px per frame, 0.1 dark counts per pixel.",
}
_FINDINGS: Mapping[str, str] = {
    "fig-4.5": (
        "As in the dissertation, EMD moves by two to three decades and IIA by two. NDM and NDS "
        "move by more than the decade printed there."
    ),
    "fig-4.6": (
        "All motion detectors go as C⁻²: 0.6 decades from 10 to 20 %, 0.1 from 80 to 90 %; the "
        "dissertation reads off about 0.5 and 0.1."
    ),
    "fig-4.7": (
        "Where dark counts outnumber the photons, N_2b rises towards their square root. Of many "
        "dark counts alone IM knows the brightness of a pixel, so that it has no N_2b."
    ),
    "fig-4.8": (
        "The spike of BM at N = 60 is 1.43 px per resized frame: half way between one whole pixel "
        "and two. IIA is flat at N = 240: noise in its gradients shrinks every velocity by the "
        "same factor."
    ),
    "fig-4.9": (
        "In the dissertation BM stays flat or worsens a little with fewer pixels; ours improves "
        "from 240 to 60 px, in every variant tried."
    ),
    "fig-4.13": (
        "As in the dissertation, BM does not gain from fewer, larger pixels, at this velocity: it "
        "does at others, and with motion blur."
    ),
}
"""What the whole figures show; the quick form may not."""
_QUICK = "Quick form, of fewer values, frame sizes and forests."


def _caption(name: str, is_quick: bool) -> str:
    findings = "" if is_quick else _FINDINGS.get(name, "")
    return f"{_CONDITIONS[name]} {findings}".strip()


def _planned_sweep(name: str) -> Planned:
    def trials(is_quick: bool) -> list[Trial]:
        return in_form(SWEEPS[name], is_quick).trials

    def figure(is_quick: bool, results: Results, templates: Templates) -> Figure:
        sweep = in_form(SWEEPS[name], is_quick)
        return sweep_figure(name, sweep, results, _caption(name, is_quick))

    return Planned(trials, figure)


def _marked(plan: Planned) -> Planned:
    """Return a plan whose quick form says so, in caption and numbers."""

    def figure(is_quick: bool, results: Results, templates: Templates) -> Figure:
        made = plan.figure(is_quick, results, templates)
        if not is_quick:
            return made
        caption = f"{_QUICK} {made.caption}"
        return replace(made, caption=caption, details={**made.details, "quick": True})

    return Planned(plan.trials, figure)


CHAPTER_4: PlannedRegistry = {
    **{name: _marked(_planned_sweep(name)) for name in SWEEPS},
    "table-4.1": _marked(TABLE_4_1),
    "table-4.times": TABLE_TIMES,
    "denominators": _marked(DENOMINATORS),
    "natural-information": _marked(NATURAL_INFORMATION),
}
