"""Chapter 4 on one page: our Table 4.1 beside the dissertation's, the figures, and what differs."""

from collections.abc import Sequence
from pathlib import Path

from megalopta.core.files import write_text
from megalopta.flow.metrics.photon_threshold import format_flux
from megalopta.flow.metrics.response_error import METRICS
from megalopta.plotting.picture import Figure
from megalopta.plotting.templates import render_page
from megalopta.reproduction.registry import names

TABLE = "table-4.1"


def write_page(out: Path, figures: Sequence[Figure]) -> Path:
    """Write chapter-4.html beside the pictures of some figures, one of them Table 4.1.

    Figures of other chapters are passed over. Returns the path of the page.
    """
    known = names("chapter-4")
    figures = [figure for figure in figures if figure.name in known]
    (table,) = (figure for figure in figures if figure.name == TABLE)
    rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    literal, ratio = ([row for row in rows if row["metric"] == name] for name in METRICS)
    page = render_page(
        "megalopta.reproduction",
        "chapter4_page.html",
        {"flux": format_flux},
        rows=list(zip(literal, ratio, strict=True)),
        figures=[figure for figure in figures if figure.name != TABLE],
        note=table.caption,
        findings=[(each.title, each.findings) for each in figures if each.findings],
        is_quick=table.details.get("quick", False),
    )
    path = out / "chapter-4.html"
    write_text(path, page)
    return path
