"""What a figure of a sweep says below it: what its points are and what moves."""

from collections.abc import Iterable, Mapping

from megalopta.assets_gen.grating import GratingVariant
from megalopta.benchmark.panorama_recipes import ROWS
from megalopta.benchmark.runner import Results
from megalopta.benchmark.sweep import Sweep
from megalopta.benchmark.templates import GratingTemplate, Template
from megalopta.reproduction.thresholds import threshold_of

_VARIANTS: Mapping[GratingVariant, str] = {
    "rot": " (rot, the dissertation's rotation: √2 times as many cycles move, with a seam)",
    "periodic": " (periodic: exactly so many move, without a seam)",
}


def panel_sizes(sweep: Sweep) -> tuple[int, ...]:
    """Return the size of each panel."""
    return (sweep.trial.size,) if sweep.vary == "size" else sweep.sizes or (sweep.trial.size,)


def points(sweep: Sweep, results: Results) -> str:
    """Say in a sentence what a point is, and where there is none."""
    search = sweep.trial.search
    level = f"{100 * 2.0 ** -search.bits[0]:g} %"
    metric = {"literal": "Eq. 4.5", "ratio": "the quotient of means"}[search.metrics[0]]
    flux = f"the photons per frame at which the error of {metric} falls to {level}"
    text = f"Each point gives {flux}, with its {100 * search.confidence:g} % interval"
    if len(sweep.templates) > 1:
        text = (
            f"Each point is the mean over {len(sweep.templates)} templates of {flux}, and its bar "
            "reaches from the least to the most of them"
        )
    return f"{text}{_missing(sweep, results)}."


def stimulus(sweep: Sweep) -> str:
    """Say in a sentence what moves, with the parameters that do not vary."""
    trial, sizes = sweep.trial, panel_sizes(sweep)
    pictures = dict.fromkeys(
        _described(each, sweep.vary) for each in sweep.templates or (trial.template,)
    )
    moving = "" if sweep.vary == "velocity_px" else f" by {trial.velocity_px} px per frame"
    side = "N" if sweep.vary == "size" or len(sizes) > 1 else str(sizes[0])
    dark = "" if sweep.vary == "search.dark_counts" else f"{trial.search.dark_counts:g} "
    parts = [
        f"What moves{moving} is {_joined(pictures)}",
        f"{dark}dark counts per pixel and frame come on top",
        "motion blurs each frame" if trial.blurred and sweep.vary != "blurred" else "",
        f"{trial.search.summed_frames} frames are summed"
        if trial.search.summed_frames > 1 and sweep.vary != "search.summed_frames"
        else "",
        f"all this refers to frames of {ROWS} × {ROWS} px, which are brought to {side} × {side} px",
    ]
    return f"{'; '.join(filter(None, parts))}."


def _joined(texts: Iterable[str]) -> str:
    *first, last = texts
    return f"{', '.join(first)} and {last}" if first else last


def _described(template: Template, vary: str) -> str:
    """Say what a template shows, less what is varied."""
    if not isinstance(template, GratingTemplate):
        if vary == "template.name":
            return "a panorama"
        gray = ", in gray values" if template.coding == "srgb" else ""
        return f"panorama {template.name}{gray}"
    parts = {
        "template.cycles_per_frame": f"{template.cycles_per_frame:g} cycles per frame",
        "template.contrast": f"{100 * template.contrast:g} % contrast",
    }
    of = " and ".join(text for path, text in parts.items() if path != vary)
    return f"a grating of {of}{'' if vary == 'template.variant' else _VARIANTS[template.variant]}"


def _missing(sweep: Sweep, results: Results) -> str:
    """Say which points are missing and why: of any template, in what is drawn."""
    search = sweep.trial.search
    reasons = {
        "undefined": "undefined",
        "above": f"more than {search.flux_max:g} photons",
        "below": f"less than {search.flux_min:g} photons",
    }
    found: dict[tuple[str, str], dict[str, None]] = {}
    for point in sweep.points:
        for method in (each.name for each in sweep.trial.detectors):
            threshold = threshold_of(
                results, point.trial, method, search.metrics[0], search.bits[0]
            )
            if threshold.flux is None:
                at = f"{point.value:g}" if isinstance(point.value, float) else str(point.value)
                where = f"{at} (N = {point.size})" if len(sweep.sizes) > 1 else at
                found.setdefault((method, reasons[threshold.kind]), {})[where] = None
    parts = [f"for {method} at {', '.join(at)} ({why})" for (method, why), at in found.items()]
    if not parts:
        return ""
    of_one = ", in one template or more," if len(sweep.templates) > 1 else ""
    return f"; there is none{of_one} {', '.join(parts)}"
