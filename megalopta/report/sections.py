"""Self-contained pages: one type of section, one template, one writer."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import wrap

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
    are_words: bool = False
    """True for cells of text, from the left"""
    charts: tuple[Markup, ...] = ()
    body: Markup = field(default=Markup(""))
    name: str = ""
    """Identifier; a section with one is linked at the top of the page."""


@dataclass(frozen=True)
class Player:
    """Slider over time that all films of a page follow, and further choices."""

    labels: Sequence[str]
    """Name of each frame"""
    shape: tuple[int, int]
    """Rows and columns of a frame"""
    real_hz: float | None = None
    """Rate of the frames in reality, if known"""
    fps: float | None = None
    """Rate to play at; default: real time where it can be followed"""
    sensors: Sequence[str] = ()
    levels: Sequence[str] = ()
    """Sensors and light levels to choose from"""

    @property
    def playback_hz(self) -> float:
        """Rate at which the page plays."""
        if self.fps or self.real_hz is None:
            return self.fps or 12.0
        return min(max(self.real_hz, 2.0), 30.0)  # what can be followed


def captioned(chart: Markup, caption: str) -> Markup:
    """Return a chart with its caption below."""
    return Markup("<figure>{}<figcaption>{}</figcaption></figure>").format(chart, caption)


def image(source: str, alt: str) -> Markup:
    """Return an image element from a data URI and a description."""
    return Markup('<img src="{}" alt="{}">').format(source, alt)


def paragraph(text: str, kind: str = "") -> Markup:
    """Return a paragraph of kind "", "note" or "warn"; empty for empty text."""
    return Markup('<p class="{}">{}</p>').format(kind, text) if text else Markup("")


def block(kind: str, *parts: Markup) -> Markup:
    """Return parts inside a box of this style-sheet class."""
    return Markup('<div class="{}">\n{}\n</div>').format(kind, Markup("\n").join(parts))


def folded(summary: str, *parts: Markup) -> Markup:
    """Return parts that show once their summary is clicked."""
    box = Markup("<details><summary>{}</summary>\n{}\n</details>")
    return box.format(summary, Markup("\n").join(parts))


def heading(title: str) -> Markup:
    """Return a heading inside a section."""
    return Markup("<h3>{}</h3>").format(title)


def table(label: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> Markup:
    """Return a table of text; the first cell of a row is its heading."""
    column, row_head = Markup('<th scope="col">{}</th>'), Markup('<th scope="row">{}</th>')
    cell, line = Markup("<td>{}</td>"), Markup("<tr>{}</tr>")
    top = Markup("").join((column if text else cell).format(text) for text in head)
    lines = Markup("\n").join(
        line.format(Markup("").join([row_head.format(first), *map(cell.format, cells)]))
        for first, *cells in rows
    )
    return Markup(
        '<div class="scroll" role="region" aria-label="{}" tabindex="0"><table>\n'
        "<thead><tr>{}</tr></thead>\n<tbody>\n{}\n</tbody></table></div>"
    ).format(label, top, lines)


def as_text(title: str, sections: Iterable[Section]) -> str:
    """Return titles, texts and tables as lines, columns aligned."""
    lines = [title]
    for section in sections:
        lines += ["", section.title, *wrap(section.text, 100)]
        rows = [row for row in (section.head, *section.rows) if any(row)]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines += ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    return "\n".join(lines)


def write_sections(
    path: Path, title: str, summary: str, sections: Iterable[Section | None], header: str = "",
    footer: str = "", player: Player | None = None,
) -> Path:  # fmt: skip
    """Write a page atomically; return its path. Text that is not marked as safe is escaped.

    `header` is HTML below the summary.
    """
    template = Environment(
        loader=PackageLoader("megalopta.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template("page.html")
    shown = [section for section in sections if section]
    parts = {"header": header, "footer": footer, "film": player, "table": table}
    write_text(path, template.render(title=title, summary=summary, sections=shown, **parts))
    return path
