"""What sections of the report are made of: pictures and tables, ready for the template."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from PIL import Image

from megalopta.plotting.text import UNDEFINED
from megalopta.report.images import Legend, data_uri, stacked

RADIANCE_FILM = "var(--radiance)"
"""The tone-mapped radiance, which is on the page once and shown in several places."""


@dataclass(frozen=True)
class Picture:
    """A still picture, or a film that follows the frame slider."""

    source: str
    """Data URI, or the style sheet's variable for the radiance film."""
    alt: str
    """What is to be seen, for those who do not see it."""
    title: str = ""
    frames: int = 0
    """Frames of a film, stacked above each other; 0 for a still."""
    legend: Legend | None = None
    note: str = ""
    """Written across the picture, where it shows nothing; part of what those read who do not see"""

    @property
    def background(self) -> str:
        """The source as CSS."""
        return self.source if self.source == RADIANCE_FILM else f"url({self.source})"


@dataclass(frozen=True)
class Table:
    """Rows of text; the first cell of a row is its heading."""

    label: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def crossed(label: str, corner: str, cells: Mapping[tuple[str, str], str]) -> Table:
    """A table of texts by row and column; a dash where there is none."""
    rows, columns = (dict.fromkeys(names) for names in zip(*cells, strict=True))
    return Table(
        label,
        (corner, *columns),
        tuple((row, *(cells.get((row, each), UNDEFINED) for each in columns)) for row in rows),
    )


def film(
    images: Sequence[Image.Image], title: str, alt: str, legend: Legend | None = None
) -> Picture:
    """Frames as one picture that follows the slider."""
    return Picture(data_uri(stacked(images)), alt, title, len(images), legend)


def still(image: Image.Image, title: str, alt: str, note: str = "") -> Picture:
    """One picture."""
    return Picture(data_uri(image), f"{alt}: {note}" if note else alt, title, note=note)
