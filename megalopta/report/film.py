"""Films: panels side by side, with what they are below them, as MP4 and GIF."""

import base64
import io
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL import Image

from megalopta.core.errors import missing_extra
from megalopta.core.files import atomic_write
from megalopta.core.progress import say
from megalopta.report.images import sheet

_MP4_PX, _GIF_PX = 1280, 640
"""Width of a film, about"""
_PANEL_PX = 480
"""Longest side of a panel, px"""
_IN_ONE_ROW = 4
_GIF_COLORS = 256
_GIF_FRAMES = 60
_GIF_BYTES = 4_000_000
_FEWEST = 8
"""Frames of a GIF that are left, however large it is"""
_GIF_MS = (20, 600_000)
"""Shortest and longest duration of a GIF frame"""
_CODECS = {"libx264": {"crf": "20", "preset": "veryfast"}, "mpeg4": {"qscale": "3"}}
"""MP4 codecs, the better first, with their options for good quality"""


@dataclass(frozen=True, eq=False)
class Moment:
    """Panels at one moment."""

    label: str
    """Frame and time"""
    pictures: Sequence[tuple[str, Image.Image]]
    """With their labels"""


def write_film(
    folder: Path, moments: Callable[[], Iterator[Moment]], frames: int, rate_hz: float
) -> list[Path]:
    """Write film.mp4, where the encoder is installed, and film.gif; return their paths.

    `moments` yields `frames` times what is seen; the GIF has fewer where it would be too large.
    """
    kept: list[Image.Image] = []
    every = math.ceil(frames / _GIF_FRAMES)
    with _mp4_writer(folder / "film.mp4", rate_hz) as write:
        for index, moment in enumerate(moments()):
            if write:
                write(composed(moment, _MP4_PX, 16))
            if index % every == 0:
                kept.append(_few_colors(composed(moment, _GIF_PX, 12)))
    with atomic_write(folder / "film.gif") as temporary:
        temporary.write_bytes(bounded_gif(kept, 1000 * every / rate_hz))
    return [folder / "film.mp4", folder / "film.gif"] if write else [folder / "film.gif"]


def composed(moment: Moment, width_px: int, letters_px: int) -> Image.Image:
    """Return pictures side by side, about so wide, in two rows where there are many.

    Pixels are magnified by a whole number, or skipped, so that they are seen as they are.
    """
    count = len(moment.pictures)
    columns = count if count <= _IN_ONE_ROW else math.ceil(count / 2)
    panel_px = min(width_px // columns, _PANEL_PX)
    drawn = [(label, magnified(each, panel_px)) for label, each in moment.pictures]
    rows = [drawn[first : first + columns] for first in range(0, count, columns)]
    return sheet(rows, letters_px, moment.label)


def magnified(picture: Image.Image, width_px: int) -> Image.Image:
    """Return a picture of about this width: pixels repeated, or one of several taken."""
    if picture.width <= width_px:
        factor = width_px // picture.width
        size = factor * picture.width, factor * picture.height
    else:
        step = math.ceil(picture.width / width_px)
        size = math.ceil(picture.width / step), math.ceil(picture.height / step)
    return picture.convert("RGB").resize(size, Image.Resampling.NEAREST)


def gif(images: Sequence[Image.Image], frame_ms: float) -> bytes:
    """Return a GIF that repeats."""
    data = io.BytesIO()
    reduced = [_few_colors(each) for each in images]
    shortest, longest = _GIF_MS
    duration = min(max(round(frame_ms), shortest), longest)
    reduced[0].save(
        data, "GIF", save_all=True, append_images=reduced[1:], duration=duration, loop=0
    )
    return data.getvalue()


def gif_uri(images: Sequence[Image.Image], frame_ms: float) -> str:
    """Return a GIF that repeats as its own address."""
    return f"data:image/gif;base64,{base64.b64encode(gif(images, frame_ms)).decode('ascii')}"


def bounded_gif(images: Sequence[Image.Image], frame_ms: float) -> bytes:
    """Return a GIF of a few MB, of every second frame, or fewer, where all are too many."""
    content = gif(images, frame_ms)
    if len(content) > _GIF_BYTES and len(images) >= 2 * _FEWEST:
        return bounded_gif(images[::2], 2 * frame_ms)
    return content


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
    name = next(each for each in _CODECS if each in av.codecs_available)
    with atomic_write(path) as temporary, av.open(str(temporary), "w") as container:
        stream = container.add_stream(name, Fraction(rate_hz).limit_denominator(1000))
        stream.pix_fmt, stream.options = "yuv420p", _CODECS[name]

        def write(picture: Image.Image) -> None:
            pixels = _even(np.asarray(picture))
            if not stream.codec_context.is_open:
                stream.height, stream.width = pixels.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, "rgb24")))

        yield write
        container.mux(stream.encode(None))


def _even(pixels: np.ndarray) -> np.ndarray:
    """Return a picture whose sides are even, as yuv420p wants them: the last line is repeated."""
    height, width = pixels.shape[:2]
    return np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), "edge")


def _few_colors(picture: Image.Image) -> Image.Image:
    return picture if picture.mode == "P" else picture.convert("RGB").quantize(_GIF_COLORS)
