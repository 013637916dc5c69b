"""The report: its sections in their order, below an opening."""

import math
from collections.abc import Callable
from pathlib import Path

from markupsafe import Markup

from megalopta.core.files import write_text
from megalopta.dataset.store import Dataset
from megalopta.generation import versions
from megalopta.plotting.sections import Section, block, heading, listed, page_of, table
from megalopta.report.closing import glossary_section, making_section, ranking_section
from megalopta.report.detectors import detector_section
from megalopta.report.light_section import light_section
from megalopta.report.motion_section import motion_section
from megalopta.report.source import Report
from megalopta.report.summary import OUTCOME, facts, lead, outcome, title
from megalopta.report.thresholds import threshold_section

SECTIONS: tuple[Callable[[Report], Section | None], ...] = (
    light_section,
    motion_section,
    detector_section,
    threshold_section,
    ranking_section,
    glossary_section,
    making_section,
)
"""What the page and its navigation show, in this order; None is passed over."""


def write_report(dataset: Dataset) -> Path:
    """Write DATASET/report.html from the stages that are finished; return its path.

    Raises
    ------
    UserError
        When nothing was rendered yet, or a file cannot be read.
    """
    path = dataset.root / "report.html"
    write_text(path, page(dataset))
    return path


def page(dataset: Dataset) -> str:
    """Return the report as HTML."""
    report = Report(dataset)
    sections = [section for make in SECTIONS if (section := make(report))]
    settings, shown = report.settings, report.selection
    return page_of(
        title(settings),
        lead(settings, report.scene),
        sections,
        header=_opening(report),
        film=report.film(),
        footer=(
            f"Written by megalopta {versions.versions()['megalopta']}. Pictures show one of "
            f"{shown.step} × {shown.step} pixels and {len(shown.frames)} of "
            f"{settings.trajectory.frames} frames; the last one has no successor and so no motion."
        ),
    )


def _opening(report: Report) -> Markup:
    """Return key numbers, and what came out."""
    counted = list(facts(report))
    many, few = (_columns(len(counted), most) for most in (8, 4))
    tiles = block("", listed("facts", counted), style=f"--many:{many};--few:{few}")
    rows = outcome(report.flow, [each.budget for each in report.exposures])
    if not rows:
        return tiles
    told = table("What came out", OUTCOME, rows)
    return tiles + block("outcome", heading("What came out"), told)


def _columns(items: int, most: int) -> int:
    """Return so many a row that rows are nearly alike, and the last holds no single one."""
    return math.ceil(items / math.ceil(items / most))
