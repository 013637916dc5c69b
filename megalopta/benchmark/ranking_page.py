"""The ranking as a page, a table and JSON."""

import csv
import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from megalopta.benchmark.camera_motion import LIKELIHOODS
from megalopta.benchmark.changes import changes
from megalopta.benchmark.findings import findings, summary
from megalopta.benchmark.measured import Example
from megalopta.benchmark.ranking_charts import (
    atlas,
    error_curves,
    flow_fields,
    pooling_grid,
)
from megalopta.benchmark.ranking_light import levels_section
from megalopta.benchmark.ranking_record import Ranking
from megalopta.benchmark.ratios import error_ratios
from megalopta.benchmark.sequence_truth import DISTANCES_M, PARALLAX_PX, SPEEDS_PX
from megalopta.core import files
from megalopta.plotting.sections import Section, write_sections
from megalopta.plotting.text import UNDEFINED, number, percent

NAME = "ranking.json"
_GROUPS = ("all", "visible", "occluded", "smooth", "depth edge", "parallax low", "parallax high")


def write_ranking(folder: Path, ranking: Ranking, example: Example) -> Path:
    """Write ranking.html, ranking.csv and ranking.json to a folder; return the page."""
    finest = ranking.settings.finest
    files.write_text(folder / "ranking.csv", _csv(ranking))
    files.write_text(folder / NAME, ranking.model_dump_json(indent=1) + "\n")
    count = len(ranking.sequences)
    groups = [name for name in _GROUPS if ranking.blocks.get(name)]
    sections = [
        Section(
            "What was measured",
            f"{count} sequence{'s'[: count > 1]}, {ranking.frames} frames, perfect pixels. "
            "Errors are those of blocks against the true motion, in px of the full image per "
            "frame; a block without an answer counts as one that answered 0; means are over all "
            "blocks. Bands hold the mean in 95 % of cases. Speed is low below "
            f"{SPEEDS_PX[0]:g} px, high above {SPEEDS_PX[1]:g} px; parallax, what is left of the "
            f"motion without the camera's rotation, below {PARALLAX_PX[0]:g} and above "
            f"{PARALLAX_PX[1]:g} px; distance below {DISTANCES_M[0]:g} and above "
            f"{DISTANCES_M[1]:g} m.",
            ("group", "blocks"),
            tuple((name, str(count)) for name, count in ranking.blocks.items() if "," not in name),
        ),
        _changes(ranking),
        Section(
            "Errors over photons",
            "The Poisson bound is the least error of an unbiased method that sees one block at a "
            "time, of known texture, or the motion itself where that is less: methods that share "
            "evidence between blocks may lie below it.",
            charts=tuple(error_curves(ranking, finest, group) for group in groups),
        ),
        Section(
            "Pooling",
            "Photons added over squares of pixels and over frames. Pale cells: within the noise "
            "of the measurement another method may be the best.",
            charts=(pooling_grid(ranking),),
        ),
        Section(
            "Atlas",
            "The best method without pooling. Gray: none beats the answer 0. Pale: not sure. "
            "White: not measured.",
            charts=(atlas(ranking),),
        ),
        levels_section(ranking),
        Section("Flow fields", _FIELDS, charts=(_fields(ranking, example),)),
        _camera(ranking),
        _yaw_rate(ranking),
        _consistency(ranking),
    ]
    page = folder / "ranking.html"
    write_sections(page, "Flow methods on rendered sequences", summary(ranking), sections)
    return page


_FIELDS = (
    "One pair of frames in the middle of the first sequence: hue is direction, saturation speed; "
    "mid gray is no answer."
)


def _fields(ranking: Ranking, example: Example) -> Markup:
    fluxes = sorted(ranking.settings.fluxes)
    found = {name: [each[flux] for flux in fluxes] for name, each in example.found.items()}
    fastest = float(np.nanquantile(np.linalg.norm(example.truth, axis=-1), 0.98))
    return flow_fields({"truth": [example.truth], **found}, fluxes, fastest or 1.0)


def _changes(ranking: Ranking) -> Section:
    rows = tuple(
        (
            each.groups.what,
            number(each.first.photons_per_frame),
            f"{each.first.worse} / {each.first.better}",
            f"{each.groups.one}: {_within(each.first.ratio, each.first.low, each.first.high)}",
            f"{each.groups.other}: "
            + _within(1 / each.second.ratio, 1 / each.second.high, 1 / each.second.low),
        )
        for each in changes(ranking)
    )
    return Section(
        "Where the ranking changes",
        " ".join(findings(ranking))
        + " In the table and the picture: the ratio of two methods' mean errors and what holds it "
        "in 95 % of cases; methods change places where it is above 1 in one group and below 1 in "
        "the other. The table holds those pairs that the rule of Benjamini and Hochberg leaves of "
        "all: a twentieth of them is expected to be chance. Blocks under rotation alone and of low "
        "or high parallax are visible ones; hidden ones are hidden in the next frame or out of its "
        "view, of sequences in which more than the camera's rotation moves the image.",
        ("changes with", "photons", "errors of", "in one group", "in the other") if rows else (),
        rows,
        charts=(error_ratios(ranking),),
    )


def _within(value: float, low: float, high: float) -> str:
    return f"{value:.2f} ({low:.2f} to {high:.2f})"


def _camera(ranking: Ranking) -> Section:
    found = {(each.photons_per_frame, each.method): each for each in ranking.camera}

    def cell(flux: float, name: str) -> str:
        each = found.get((flux, name))
        return f"{_degrees(each.rotation_deg)}, {_degrees(each.heading_deg)}" if each else UNDEFINED

    return Section(
        "The camera's motion",
        "From the velocities of all blocks of a pair of frames, or as the motion under which the "
        "counts of two frames, or of eight around the pair, are most likely: angle between the "
        "estimated and the true rotation, and between the estimated and the true direction of "
        f"translation (medians of up to {ranking.settings.camera_pairs} pairs of each sequence; "
        "eight frames take a sequence as long).",
        *_by_photons(ranking, cell, (*ranking.settings.methods, *LIKELIHOODS)),
    )


def _yaw_rate(ranking: Ranking) -> Section:
    found = {(each.photons_per_frame, each.method): each for each in ranking.yaw_rates}
    names = (*ranking.settings.methods, *ranking.settings.wide_field)

    def cell(flux: float, name: str) -> str:
        each = found.get((flux, name))
        return f"{each.counts_deg_s:.2g} ({each.ideal_deg_s:.2g})" if each else UNDEFINED

    true = next((f"{each.true_deg_s:.3g}" for each in ranking.yaw_rates), UNDEFINED)
    return Section(
        "The yaw rate, also of methods without velocities",
        "Root mean square error (deg/s) of the camera's yaw rate from a weighted sum of all "
        "answers, in parentheses that without noise; weights are learned from clean answers to the "
        f"first half of a sequence and tried on the second. The true rate is {true} deg/s (medians "
        "of the sequences in which the camera turns, and long enough for the method's memory). "
        "Methods that are blind to direction (NDM, NDS, IM) can be judged neither by velocity nor "
        "by yaw rate, and are not ranked.",
        *_by_photons(ranking, cell, names),
    )


def _consistency(ranking: Ranking) -> Section:
    finest = ranking.settings.finest
    found = {
        (each.photons_per_frame, each.method): each.error
        for each in ranking.consistency
        if each.pooling == finest
    }
    return Section(
        "Agreement with itself",
        "Error against the same method's answer to the light without noise (Eq. 4.5): it says "
        "how well an answer repeats, not whether it is true.",
        *_by_photons(ranking, lambda flux, name: percent(found.get((flux, name)))),
    )


def _by_photons(
    ranking: Ranking, cell: Callable[[float, str], str], names: Sequence[str] = ()
) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Head and rows of a table of methods by photons per frame."""
    fluxes = sorted(ranking.settings.fluxes)
    rows = tuple(
        (name, *(cell(flux, name) for flux in fluxes)) for name in names or ranking.settings.methods
    )
    return ("method", *(f"{number(flux)} photons" for flux in fluxes)), rows


def _degrees(value: float | None) -> str:
    return UNDEFINED if value is None else f"{value:.2g}°"


def _csv(ranking: Ranking) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = "pixels_pooled frames_pooled photons_per_frame group method epe_px low_px high_px"
    writer.writerow(names.split())
    for each in ranking.errors:
        case = each.pixels, each.frames, f"{each.photons_per_frame:g}", each.group, each.method
        writer.writerow([*case, *(_digits(value) for value in (each.mean, each.low, each.high))])
    return text.getvalue()


def _digits(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
