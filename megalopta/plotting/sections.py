"""A report of sections: text, tables and charts on one page without outside links."""

from dataclasses import dataclass, field
from pathlib import Path

from markupsafe import Markup

from megalopta.core.files import write_text
from megalopta.plotting.templates import render_page


@dataclass(frozen=True)
class Section:
    """One part of a page."""

    title: str
    text: str = ""
    head: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    charts: tuple[Markup, ...] = field(default=())


def captioned(chart: Markup, caption: str) -> Markup:
    """Return a chart with what it says below it."""
    return Markup("<figure>{}<figcaption>{}</figcaption></figure>").format(chart, caption)


def write_sections(path: Path, title: str, summary: str, sections: list[Section]) -> None:
    """Write a page, whole or not at all."""
    page = render_page(
        "megalopta.plotting", "page.html", title=title, summary=summary, sections=sections
    )
    write_text(path, page)
