"""The gallery as one picture, and as one page without outside links."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from megalopta.core.files import atomic_write, write_text
from megalopta.plotting.templates import render_page
from megalopta.plotting.text import level_name, lux, number
from megalopta.report.images import data_uri, gray_scale

_WIDTH, _GAP, _LINE = 188, 6, 18
_PAPER, _INK, _FAINT = (255, 255, 255), (26, 26, 26), (110, 110, 110)


@dataclass(frozen=True)
class Cell:
    """One scene in one light."""

    scene: str
    level: str
    illuminance_lux: float
    """Of an unshaded horizontal plane"""
    view: NDArray[np.uint8]
    """The radiance (H, W, 3), exposed and white-balanced for its own light"""
    counts: NDArray[np.integer | np.floating]
    """Of a sensor, in one exposure (H, W)"""
    canopy: str = ""
    """What a forest holds and lets through, measured; empty where that is not told"""

    @property
    def light(self) -> str:
        """Name and strength of the light, for people."""
        return _plain(f"{level_name(self.level)}, {lux(self.illuminance_lux)}")

    @property
    def photons(self) -> str:
        """Mean count, for people."""
        return _plain(f"{number(float(np.mean(self.counts)))} photons per pixel")

    @property
    def view_image(self) -> Image.Image:
        """The view."""
        return Image.fromarray(self.view)

    @property
    def counts_image(self) -> Image.Image:
        """The counts."""
        return gray_counts(self.counts)


def gray_counts(counts: NDArray[np.integer | np.floating]) -> Image.Image:
    """Counts (H, W) as a picture, from black to the brightest hundredth."""
    values = np.asarray(counts, dtype=np.float64)
    return gray_scale(max(float(np.percentile(values, 99)), 1.0)).picture(values)


def write_sheet(path: Path, cells: Sequence[Cell]) -> None:
    """Write all cells as one PNG: a row of views and a row of counts for each scene."""
    rows = [list(group) for _, group in groupby(cells, lambda cell: cell.scene)]
    height, width = cells[0].view.shape[:2]
    size = (_WIDTH, round(_WIDTH * height / width))
    row_height = 2 * (size[1] + _LINE) + 2 * _GAP
    columns, head = max(map(len, rows)), 2 * _LINE + _GAP
    whole = columns * (_WIDTH + _GAP) + _GAP, head + len(rows) * row_height
    sheet = Image.new("RGB", whole, _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(12)
    for row, group in enumerate(rows):
        top = head + row * row_height
        draw.text((_GAP, top), group[0].scene, _INK, ImageFont.load_default(14))
        top += _LINE
        for column, cell in enumerate(group):
            left = _GAP + column * (_WIDTH + _GAP)
            if row == 0:
                draw.text((left, _GAP), cell.light.replace(", ", "\n"), _INK, font)
            sheet.paste(cell.view_image.resize(size, Image.Resampling.LANCZOS), (left, top))
            below = top + size[1] + _GAP
            counts = cell.counts_image.convert("RGB").resize(size, Image.Resampling.BOX)
            sheet.paste(counts, (left, below))
            draw.text((left, below + size[1] + 1), cell.photons, _FAINT, font)
    with atomic_write(path) as temporary:
        sheet.quantize(256).save(temporary, "PNG", optimize=True)


def write_page(path: Path, cells: Sequence[Cell], exposure_s: float) -> None:
    """Write all cells as one HTML page with the pictures inside it."""
    rows = [(scene, list(group)) for scene, group in groupby(cells, lambda cell: cell.scene)]
    values = {"rows": rows, "exposure_ms": 1e3 * exposure_s}
    page = render_page("megalopta.report", "gallery_page.html", {"data_uri": data_uri}, **values)
    write_text(path, page)


def _plain(text: str) -> str:
    """The text with plain spaces: the sheet's font knows no others."""
    return " ".join(text.split())
