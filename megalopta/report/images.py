"""Arrays as pictures: PNG data URIs, color scales and their legends, stills and films of a page.

Films show some frames and pixels (`Selection`).
"""

import base64
import colorsys
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from markupsafe import Markup
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont, ImageOps

from megalopta.core.files import atomic_write
from megalopta.flow.color_wheel import wheel_legend
from megalopta.plotting.sections import block, captioned, image, paragraph

Rgb = NDArray[np.uint8]
Floats = NDArray[np.floating]

# Few colors and bits make small files; noisy pictures look the same.
_COLORS = 96
_ID_COLORS = 89
_RGB_BITS = 6
_LEGEND_STEPS = 128
_GAP = 6
"""Gap between pictures of a sheet (px)"""

ORANGE = (230, 97, 0)
GRAY = (128, 128, 128)
_NOTHING = (24, 26, 30)

_WHEEL_PX = 96
COLORS = Markup(
    "<b>Motion as color.</b> Hue is direction: red right, yellow down, cyan left, violet up. White "
    "is no motion; full color, at the rim, is {:.2g} px per frame; darker is faster; gray is "
    "undefined."
)


@dataclass(frozen=True)
class ColorScale:
    """Maps values to colors; values beyond the ends get the colors of the ends."""

    low: float
    high: float
    colors: Rgb
    """Colors from low to high, (n, 3)"""
    special: tuple[int, int, int] = GRAY
    """Color of marked pixels and of NaN"""
    root: float = 1.0
    """Colors are uniform in this root of the value, on each side of 0 for a scale with two; 2.2
    makes the luminance of grays proportional to the value."""
    logarithmic: bool = False
    """Colors are uniform in the logarithm of the value instead."""

    def picture(self, values: Floats, marked: NDArray[np.bool_] | None = None) -> Image.Image:
        """Return an image of values (H, W), NaN or marked pixels in the special color."""
        unknown = np.isnan(values) if marked is None else marked | np.isnan(values)
        index = np.where(unknown, len(self.colors), self._index(np.nan_to_num(values)))
        picture = Image.fromarray(index.astype(np.uint8))
        picture.putpalette(self.colors.tobytes() + bytes(self.special))
        return picture

    def legend(self, low: str, high: str, special: str = "") -> Markup:
        """Return the legend: the colors between two texts, and the meaning of the special color."""
        steps = (np.arange(_LEGEND_STEPS) + 0.5) / _LEGEND_STEPS
        values = self.low + (self.high - self.low) * steps
        if self.logarithmic:
            values = self.low * (self.high / self.low) ** steps
        bar = image(data_uri(self.picture(values[np.newaxis])), f"color scale from {low} to {high}")
        marked = Markup('<span class="special"><i style="background:rgb{}"></i>{}</span>')
        return Markup('<span class="scale"><span>{}</span>{}<span>{}</span>{}</span>').format(
            low, bar, high, marked.format(self.special, special) if special else ""
        )

    def _index(self, values: Floats) -> NDArray[np.int64]:
        low, high = self._stretched(self.low), self._stretched(self.high)
        bounded = self._stretched(np.clip(values, self.low, self.high))
        return np.rint((bounded - low) / (high - low) * (len(self.colors) - 1)).astype(np.int64)

    def _stretched(self, values: Floats | float) -> Floats:
        if self.logarithmic:
            return np.log(values)
        return np.sign(values) * np.abs(values) ** (1 / self.root)


def gray_scale(white: float) -> ColorScale:
    """Light from 0 (black) to `white`; marked pixels are orange."""
    ramp = np.linspace(0, 255, _COLORS).astype(np.uint8)
    colors = np.repeat(ramp[:, np.newaxis], 3, axis=1)
    return ColorScale(0.0, white, colors, ORANGE, root=2.2)


def gray_counts(counts: NDArray[np.integer | np.floating]) -> Image.Image:
    """Return counts (H, W) as a picture, from black to the brightest 1 %."""
    values = np.asarray(counts, dtype=np.float64)
    return gray_scale(max(float(np.percentile(values, 99)), 1.0)).picture(values)


def map_scale(
    name: str, low: float, high: float, root: float = 1.0, logarithmic: bool = False
) -> ColorScale:
    """A matplotlib color map between two values."""
    colors = np.asarray(colormaps[name](np.linspace(0, 1, _COLORS), bytes=True))
    return ColorScale(low, high, colors[:, :3], root=root, logarithmic=logarithmic)


def rgb_picture(pixels: Rgb) -> Image.Image:
    """Return an image of colors (H, W, 3)."""
    return ImageOps.posterize(Image.fromarray(pixels), _RGB_BITS)


def id_picture(identifiers: NDArray[np.integer]) -> Image.Image:
    """Return an image of object numbers (H, W), successive ones in distinct colors; 0 is dark."""
    index = np.where(identifiers == 0, 0, 1 + identifiers % _ID_COLORS)
    picture = Image.fromarray(index.astype(np.uint8))
    picture.putpalette([*_NOTHING, *(part for n in range(_ID_COLORS) for part in _id_color(n))])
    return picture


def film_strip(images: Sequence[Image.Image]) -> Image.Image:
    """Return images of equal size as one, stacked vertically."""
    first = images[0]
    film = Image.new(first.mode, (first.width, first.height * len(images)))
    if first.mode == "P":
        film.putpalette(first.getpalette() or [])
    for index, each in enumerate(images):
        film.paste(each, (0, index * first.height))
    return film


def film(images: Sequence[Image.Image] | None, title: str, alt: str, legend: str = "") -> Markup:
    """Return frames as a picture that follows the slider; None: the radiance of the page."""
    source = f"url({data_uri(film_strip(images))})" if images else "var(--radiance)"
    picture = Markup(
        '<div class="film" role="img" aria-label="{}" style="background-image:{}"></div>'
    ).format(alt, source)
    return captioned(picture, Markup("{}{}").format(title, legend))


def still(picture: Image.Image, title: str, alt: str, note: str = "") -> Markup:
    """Return one picture; a note is written across it."""
    description = f"{alt}: {note}" if note else alt
    across = Markup('<span class="nothing" aria-hidden="true">{}</span>').format(note)
    shown = Markup('<div class="frame"><img class="still" src="{}" alt="{}">{}</div>').format(
        data_uri(picture), description, across if note else ""
    )
    return captioned(shown, title)


def sheet(
    rows: Sequence[Sequence[tuple[str, Image.Image]]], letters_px: int = 12, footer: str = ""
) -> Image.Image:
    """Return rows of pictures, each with its title below, as one; the footer is below all."""
    line_px = letters_px * 3 // 2
    lines = [line_px if any(title for title, _ in row) else 0 for row in rows]
    heights = [max(each.height for _, each in row) + _GAP for row in rows]
    width = max(sum(each.width + _GAP for _, each in row) for row in rows) + _GAP
    below = line_px if footer else 0
    sheet = Image.new("RGB", (width, sum(lines) + sum(heights) + _GAP + below), "white")
    draw, font, top = ImageDraw.Draw(sheet), ImageFont.load_default(letters_px), _GAP
    for row, line, height in zip(rows, lines, heights, strict=True):
        left = _GAP
        for title, picture in row:
            sheet.paste(picture, (left, top))
            draw.text((left, top + picture.height + 1), _spaced(title), "black", font)
            left += picture.width + _GAP
        top += line + height
    draw.text((_GAP, top), _spaced(footer), "black", font)
    return sheet


def _spaced(text: str) -> str:
    """Return a text with plain spaces: the font has no others."""
    return " ".join(text.split())


def write_sheet(path: Path, rows: Sequence[Sequence[tuple[str, Image.Image]]]) -> None:
    """Write rows of pictures with titles, as one PNG of few colors or JPEG."""
    drawn = sheet(rows)
    with atomic_write(path) as temporary:
        if path.suffix == ".png":
            drawn.quantize(256).save(temporary, "PNG", optimize=True)
        else:
            drawn.save(temporary, "JPEG", quality=88)


def wheel(text: str, *beside: Markup) -> Markup:
    """Return the color wheel of motion with a text."""
    drawn = image(data_uri(Image.fromarray(wheel_legend(_WHEEL_PX))), "Color wheel of motion")
    return block("wheel", *beside, drawn, paragraph(text))


def data_uri(picture: Image.Image) -> str:
    """Return an image as a PNG data URI."""
    data = io.BytesIO()
    picture.save(data, "PNG")
    return f"data:image/png;base64,{base64.b64encode(data.getvalue()).decode('ascii')}"


def _id_color(number: int) -> tuple[int, ...]:
    # Multiples of the golden ratio spread evenly over the hues.
    hue, value = number * 0.618034 % 1, 0.55 + 0.4 * (number * 0.7548777 % 1)
    return tuple(round(255 * part) for part in colorsys.hsv_to_rgb(hue, 0.45, value))


Item = TypeVar("Item")

PLAYBACK_HZ = (2.0, 30.0)
"""Frame rates at which a film can be followed (Hz)."""
_FASTEST_PERCENT, _SLOWEST = 99.0, 1e-3
_MOST_PIXELS_SHOWN = 8_000_000
"""Limit of all films of a page"""


def fastest_of(flows: Iterable[NDArray[np.floating]]) -> float:
    """Return the speed that has the full color, two digits: all but a hundredth are slower."""
    speed = np.concatenate([np.hypot(*np.moveaxis(each, -1, 0)).ravel() for each in flows])
    known = speed[np.isfinite(speed)]
    fastest = float(np.percentile(known, _FASTEST_PERCENT)) if known.size else 0.0
    return float(f"{max(fastest, _SLOWEST):.1e}")


class Selection(NamedTuple):
    """Frames shown, by number from 0, and step of the pixels shown."""

    frames: tuple[int, ...]
    step: int


def selection(
    frames: range, shape: tuple[int, int], films: int, longest_px: int, most_frames: int
) -> Selection:
    """Choose the frames and pixels that fit a page with this many films."""
    step = math.ceil(max(shape) / longest_px)
    fitting = _MOST_PIXELS_SHOWN * step**2 // (math.prod(shape) * films)
    return Selection(evenly_spaced(frames, max(min(most_frames, fitting), 1)), step)


def evenly_spaced(frames: Sequence[int], most: int) -> tuple[int, ...]:
    """Return at most `most` of the frames, evenly spaced, starting with the first."""
    count = min(len(frames), most)
    return tuple(frames[index * len(frames) // count] for index in range(count))


def with_ends(items: Sequence[Item], most: int) -> list[Item]:
    """Return at most `most` of some items, evenly spaced, with the first and the last."""
    last, count = len(items) - 1, min(len(items), most)
    return [items[round(index * last / max(count - 1, 1))] for index in range(count)]


def frame_label(frame: int, times_s: NDArray[np.float64] | None, summed: int = 1) -> str:
    """Return the label of a frame, or of a sum of frames, with its time if known."""
    name = f"frame {frame + 1}" if summed == 1 else f"frames {frame + 1} to {frame + summed}"
    if times_s is None:
        return name
    period = float(times_s[-1] - times_s[0]) / max(len(times_s) - 1, 1)
    decimals = max(2, math.ceil(-math.log10(period))) if period > 0 else 2
    return f"{name} · {times_s[frame]:.{decimals}f} s"
