"""Self-contained pages: one type of section, one template, one writer."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from megalopta.core.files import write_text


@dataclass(frozen=True)
class Section:
    """One part of a page, in this order: text, a table, a grid of charts, and HTML."""

    title: str
    text: str = ""
    head: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    charts: tuple[Markup, ...] = field(default=())
    body: Markup = field(default=Markup(""))
    name: str = ""
    """Identifier; a section with one is linked at the top of the page."""
    link: str = ""
    """Text of that link; default: the title"""

    @property
    def table(self) -> Markup:
        """Table as HTML; empty without rows."""
        return table(self.title, self.head, self.rows) if self.rows else Markup("")


def captioned(chart: Markup, caption: str) -> Markup:
    """Return a chart with its caption below."""
    return Markup("<figure>{}<figcaption>{}</figcaption></figure>").format(chart, caption)


def image(source: str, alt: str) -> Markup:
    """Return an image element from a data URI and a description."""
    return Markup('<img src="{}" alt="{}">').format(source, alt)


def paragraph(text: str, kind: str = "") -> Markup:
    """Return a paragraph of kind "", "note" or "warn"; empty for empty text."""
    return Markup('<p class="{}">{}</p>').format(kind, text) if text else Markup("")


def block(kind: str, *parts: Markup, style: str = "") -> Markup:
    """Return parts inside a box of this style-sheet class."""
    inside = Markup("\n").join(parts)
    return Markup('<div class="{}" style="{}">\n{}\n</div>').format(kind, style, inside)


def card(title: str, *parts: Markup, kind: str = "card") -> Markup:
    """Return parts in a frame below a title."""
    return block(kind, heading(title), *parts)


def heading(title: str) -> Markup:
    """Return a heading inside a section."""
    return Markup("<h3>{}</h3>").format(title)


def folded(summary: str, inside: Markup) -> Markup:
    """Return content that opens on a click on its summary."""
    return Markup("<details><summary>{}</summary>\n{}</details>").format(summary, inside)


def definitions(kind: str, pairs: Iterable[tuple[str, str]]) -> Markup:
    """Return a definition list of this class."""
    rows = (Markup("<div><dt>{}</dt><dd>{}</dd></div>").format(*pair) for pair in pairs)
    return Markup('<dl class="{}">{}</dl>').format(kind, Markup("").join(rows))


def table(label: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> Markup:
    """Return a table of text; the first cell of a row is its heading."""
    column, row_head = Markup('<th scope="col">{}</th>'), Markup('<th scope="row">{}</th>')
    cell, line = Markup("<td>{}</td>"), Markup("<tr>{}</tr>")
    top = Markup("").join((column if text else cell).format(text) for text in head)
    lines = Markup("\n").join(
        line.format(Markup("").join([row_head.format(first), *map(cell.format, others)]))
        for first, *others in rows
    )
    return Markup(
        '<div class="scroll" role="region" aria-label="{}" tabindex="0"><table>\n'
        "<thead><tr>{}</tr></thead>\n<tbody>\n{}\n</tbody></table></div>"
    ).format(label, top, lines)


def write_sections(
    path: Path, title: str, summary: str, sections: Iterable[Section | None], **parts: Any
) -> Path:
    """Write a page atomically; return its path. Text that is not marked as safe is escaped.

    Further parts are `header`, HTML below the summary, `footer`, and the `film` with a slider
    (`megalopta.report.source.Report.film`).
    """
    template = Environment(
        loader=PackageLoader("megalopta.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template("page.html")
    values = {"header": "", "footer": "", "film": None, **parts}
    shown = [section for section in sections if section]
    text = template.render(title=title, summary=summary, sections=shown, **values)
    write_text(path, text)
    return path
