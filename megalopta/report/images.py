"""Arrays as pictures, and pictures as films: PNG of a page, contact sheets, GIF and MP4.

Pixels are repeated or skipped, never averaged, so that noise keeps its strength.
"""

import base64
import io
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

import numpy as np
from markupsafe import Markup
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont, ImageOps

from megalopta.core.errors import missing_extra
from megalopta.core.files import atomic_write
from megalopta.core.progress import say
from megalopta.flow.color_wheel import wheel_legend
from megalopta.report.sections import block, captioned, image, paragraph

Rgb = NDArray[np.uint8]
Floats = NDArray[np.floating]
Item = TypeVar("Item")

ORANGE = (230, 97, 0)
GRAY = (128, 128, 128)

_COLORS, _RGB_BITS = 96, 6
_LEGEND_STEPS, _WHEEL_PX = 128, 96
_GAP_PX = 6
_WHEEL = Markup(
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
    """Colors are uniform in this root of the value above `low`; 2.2 makes the luminance of grays
    proportional to the value."""

    def picture(self, values: Floats, marked: NDArray[np.bool_] | None = None) -> Image.Image:
        """Return an image of values (H, W), NaN or marked pixels in the special color."""
        unknown = np.isnan(values) if marked is None else marked | np.isnan(values)
        share = (np.nan_to_num(values) - self.low) / (self.high - self.low)
        place = np.clip(share, 0, 1) ** (1 / self.root) * (len(self.colors) - 1)
        index = np.where(unknown, len(self.colors), np.rint(place))
        picture = Image.fromarray(index.astype(np.uint8))
        picture.putpalette(self.colors.tobytes() + bytes(self.special))
        return picture

    def legend(self, low: str, high: str, special: str = "") -> Markup:
        """Return the legend: the colors between two texts, and the meaning of the special color."""
        steps = (np.arange(_LEGEND_STEPS) + 0.5) / _LEGEND_STEPS
        values = self.low + (self.high - self.low) * steps
        bar = image(data_uri(self.picture(values[np.newaxis])), f"color scale from {low} to {high}")
        marked = Markup('<span class="special"><i style="background:rgb{}"></i>{}</span>')
        return Markup('<span class="scale"><span>{}</span>{}<span>{}</span>{}</span>').format(
            low, bar, high, marked.format(self.special, special) if special else ""
        )


def gray_scale(white: float, black: float = 0.0) -> ColorScale:
    """Light from `black` to `white`; marked pixels are orange."""
    ramp = np.linspace(0, 255, _COLORS).astype(np.uint8)
    return ColorScale(black, white, np.repeat(ramp[:, np.newaxis], 3, axis=1), ORANGE, root=2.2)


def map_scale(name: str, low: float, high: float) -> ColorScale:
    """A matplotlib color map between two values."""
    colors = np.asarray(colormaps[name](np.linspace(0, 1, _COLORS), bytes=True))
    return ColorScale(low, high, colors[:, :3])


def rgb_picture(pixels: Rgb) -> Image.Image:
    """Return an image of colors (H, W, 3)."""
    return ImageOps.posterize(Image.fromarray(pixels), _RGB_BITS)


def data_uri(picture: Image.Image) -> str:
    """Return an image as a PNG data URI."""
    data = io.BytesIO()
    picture.save(data, "PNG")
    return f"data:image/png;base64,{base64.b64encode(data.getvalue()).decode('ascii')}"


def film_strip(images: Sequence[Image.Image]) -> Image.Image:
    """Return images of equal size as one, stacked vertically."""
    first = images[0]
    film = Image.new(first.mode, (first.width, first.height * len(images)))
    if first.mode == "P":
        film.putpalette(first.getpalette() or [])
    for index, picture in enumerate(images):
        film.paste(picture, (0, index * first.height))
    return film


def film(images: Sequence[Image.Image], title: str, alt: str, legend: str = "") -> Markup:
    """Return frames as a picture that follows the slider."""
    picture = Markup(
        '<div class="film" role="img" aria-label="{}" style="background-image:url({})"></div>'
    ).format(alt, data_uri(film_strip(images)))
    return captioned(picture, Markup("{}{}").format(title, legend))


def wheel(rim_px: float) -> Markup:
    """Return the color wheel of motion, whose rim is a speed in px per frame."""
    drawn = image(data_uri(Image.fromarray(wheel_legend(_WHEEL_PX))), "Color wheel of motion")
    return block("wheel", drawn, paragraph(_WHEEL.format(rim_px)))


def fastest_of(flows: Iterable[NDArray[np.floating]]) -> float:
    """Return the speed that has the full color, two digits: all but a hundredth are slower."""
    speed = np.concatenate([np.hypot(*np.moveaxis(flow, -1, 0)).ravel() for flow in flows])
    known = speed[np.isfinite(speed)]
    fastest = float(np.percentile(known, 99)) if known.size else 0.0
    return float(f"{max(fastest, 1e-3):.1e}")


def selection(
    frames: range, shape: tuple[int, int], films: int, longest_px: int, most_frames: int
) -> tuple[tuple[int, ...], int]:
    """Choose the frames, and the step between pixels, that fit a page with this many films."""
    step = math.ceil(max(shape) / longest_px)
    fitting = 8_000_000 * step**2 // (math.prod(shape) * films)
    return evenly_spaced(frames, max(min(most_frames, fitting), 1)), step


def evenly_spaced(items: Sequence[Item], most: int) -> tuple[Item, ...]:
    """Return at most `most` of some items, evenly spaced, with the first and the last."""
    last, count = len(items) - 1, min(len(items), most)
    return tuple(items[round(index * last / max(count - 1, 1))] for index in range(count))


def frame_label(frame: int, times_s: NDArray[np.float64] | None, summed: int = 1) -> str:
    """Return the label of a frame, or of a sum of frames, with its time if known."""
    name = f"frame {frame + 1}" if summed == 1 else f"frames {frame + 1} to {frame + summed}"
    if times_s is None:
        return name
    period = float(times_s[-1] - times_s[0]) / max(len(times_s) - 1, 1)
    unit, scale = ("ms", 1e3) if 0 < period < 0.9e-3 else ("s", 1.0)
    decimals = max(2, math.ceil(-math.log10(period * scale) - 1e-9)) if period > 0 else 2
    return f"{name} · {scale * times_s[frame]:.{decimals}f} {unit}"


Row = Sequence[tuple[str, Image.Image]]
"""Pictures with their titles"""


def sheet(rows: Sequence[Row], letters_px: int = 12, footer: str = "") -> Image.Image:
    """Return rows of pictures, each with its title below, as one; the footer is below all."""
    line_px = letters_px * 3 // 2
    lines = [line_px if any(title for title, _ in row) else 0 for row in rows]
    heights = [max(picture.height for _, picture in row) + _GAP_PX for row in rows]
    width = max(sum(picture.width + _GAP_PX for _, picture in row) for row in rows) + _GAP_PX
    below = line_px if footer else 0
    drawn = Image.new("RGB", (width, sum(lines) + sum(heights) + _GAP_PX + below), "white")
    draw, font, top = ImageDraw.Draw(drawn), ImageFont.load_default(letters_px), _GAP_PX
    texts = [(footer, _GAP_PX, drawn.height - below - _GAP_PX)]
    for row, line, height in zip(rows, lines, heights, strict=True):
        left = _GAP_PX
        for title, picture in row:
            drawn.paste(picture, (left, top))
            texts.append((title, left, top + picture.height + 1))
            left += picture.width + _GAP_PX
        top += line + height
    for text, left, top in texts:  # the font has no space but the plain one
        draw.text((left, top), " ".join(text.split()), "black", font)
    return drawn


_PANEL_PX, _IN_ONE_ROW = 480, 4
_GIF_FRAMES, _FEWEST_GIF_FRAMES, _GIF_BYTES = 60, 8, 4_000_000
_GIF_MS = (20, 600_000)
"""Shortest and longest duration of a GIF frame"""


def composed(label: str, pictures: Row, width_px: int, letters_px: int) -> Image.Image:
    """Return pictures side by side, about so wide, in two rows where there are many.

    Pixels are magnified by a whole number, or skipped.
    """
    columns = len(pictures) if len(pictures) <= _IN_ONE_ROW else math.ceil(len(pictures) / 2)
    panel_px = min(width_px // columns, _PANEL_PX)
    drawn = []
    for title, picture in pictures:
        magnified, skipped = panel_px // picture.width, math.ceil(picture.width / panel_px)
        size = [math.ceil(max(magnified, 1) * side / skipped) for side in picture.size]
        drawn.append((title, picture.convert("RGB").resize(size, Image.Resampling.NEAREST)))
    rows = [drawn[first : first + columns] for first in range(0, len(drawn), columns)]
    return sheet(rows, letters_px, label)


def write_film(
    folder: Path, moments: Iterable[tuple[str, Row]], frames: int, rate_hz: float
) -> list[Path]:
    """Write film.mp4, where the encoder is installed, and film.gif; return their paths.

    There are `frames` moments: a label, and pictures with titles. The GIF skips frames if needed.
    """
    shown: list[Image.Image] = []
    every = math.ceil(frames / _GIF_FRAMES)
    with _mp4_writer(folder / "film.mp4", rate_hz) as write:
        for index, (label, pictures) in enumerate(moments):
            if write:
                write(composed(label, pictures, 1280, 16))
            if index % every == 0:
                shown.append(composed(label, pictures, 640, 12).quantize(256))
    frame_ms = 1000 * every / rate_hz
    while len(content := gif(shown, frame_ms)) > _GIF_BYTES and len(shown) > _FEWEST_GIF_FRAMES:
        shown, frame_ms = shown[::2], 2 * frame_ms
    with atomic_write(folder / "film.gif") as temporary:
        temporary.write_bytes(content)
    return [folder / "film.mp4", folder / "film.gif"] if write else [folder / "film.gif"]


def gif(images: Sequence[Image.Image], frame_ms: float) -> bytes:
    """Return a GIF that repeats."""
    first, *later_frames = [
        picture if picture.mode == "P" else picture.convert("RGB").quantize(256)
        for picture in images
    ]
    data, duration = io.BytesIO(), min(max(round(frame_ms), _GIF_MS[0]), _GIF_MS[1])
    first.save(data, "GIF", save_all=True, append_images=later_frames, duration=duration, loop=0)
    return data.getvalue()


@contextmanager
def _mp4_writer(path: Path, rate_hz: float) -> Iterator[Callable[[Image.Image], None] | None]:
    """Yield a function that appends a picture to a film; without an encoder, say so, yield None."""
    try:
        import av
    except ModuleNotFoundError as error:
        if (problem := missing_extra(error)) is None:
            raise
        say(f"view: no film.mp4: {problem}; film.gif is written")
        yield None
        return
    with atomic_write(path) as temporary, av.open(str(temporary), "w") as container:
        stream = container.add_stream("libx264", Fraction(rate_hz).limit_denominator(1000))
        stream.pix_fmt, stream.options = "yuv420p", {"crf": "20", "preset": "veryfast"}

        def write(picture: Image.Image) -> None:
            # yuv420p needs even sides: the last line is repeated
            padding = (0, picture.height % 2), (0, picture.width % 2), (0, 0)
            pixels = np.pad(np.asarray(picture), padding, "edge")
            if not stream.codec_context.is_open:
                stream.height, stream.width = pixels.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, "rgb24")))

        yield write
        container.mux(stream.encode(None))
