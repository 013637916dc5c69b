"""TIFF pictures, one or more pages in a file: tags read with tifffile, 8 bits with Pillow."""

import logging
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray
from tifffile import PHOTOMETRIC, TiffFile

from megalopta.core.bounded import ARRAY_BYTES, check_count, check_decoded, read_bytes
from megalopta.core.errors import DamagedFileError
from megalopta.render.footage import frames

_ORIENTATION = 274
TURNS = {
    2: (False, True, False),
    3: (False, True, True),
    4: (False, False, True),
    5: (True, False, False),
    6: (True, True, False),
    7: (True, True, True),
    8: (True, False, True),
}
"""Arguments of `turned` for an orientation of TIFF or Exif."""
_MOST_PAGES, _COPIES = 100_000, 4
_TOLD = {
    *("TransferFunction", "TransferRange", "PrimaryChromaticities", "WhitePoint", "XPosition"),
    *("YPosition", "ModelPixelScaleTag", "ModelTiepointTag", "ExposureTime", "FNumber", "GPSTag"),
    *("ReferenceBlackWhite", "StoNits", "BaselineExposure", "AsShotNeutral", "BlackLevel"),
    *("WhiteLevel", "ExifTag"),
}
"""Tags on place, light and time without effect."""
_ASSOCIATED, STRAIGHT = 1, 2
"""Kinds of alpha: colors are multiplied with it, or not."""

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # we report errors ourselves


def tiff_header(path: Path) -> frames.Header:
    """Return what a TIFF file states. Raises DamagedFileError."""
    with TiffFile(path) as file:
        with suppress(IndexError):
            file.pages[_MOST_PAGES]  # the number of pages would be counted one by one
            check_count(path, "pages", len(file.pages), _MOST_PAGES)
        page: Any = file.pages.first
        pages = tuple(n for n, picture in enumerate(file.pages) if _kind(picture) == _kind(page))
        count = len(pages)
        depth, notes = _depth(path, page), []
        if omitted := len(file.pages) - count:
            notes.append(
                f"{path} holds {count + omitted} pictures; {omitted} differ from the first in "
                "size or kind, and are not read"
            )
        x, y = (page.tags.get(name) for name in ("XResolution", "YResolution"))
        if x and y and all(tag.value[0] and tag.value[1] for tag in (x, y)):
            (across, per), (down, per_down) = x.value, y.value
            notes += frames.not_square(path, down * per / (per_down * across))
        alpha = sum(kind in (_ASSOCIATED, STRAIGHT) for kind in page.extrasamples)
        if (alien := page.samplesperpixel - _colors(page) - alpha) > 0:
            notes.append(f"{path} has {alien} further values in a pixel, which are not read")
        if 34675 in page.tags:
            notes += profile_left_out(path, bytes(page.tags[34675].value))
        placed = {tag.name: tag.value for tag in page.tags if tag.name in _TOLD}
        notes += frames.unused(path, placed)
        times_s, more = _imagej(path, file, count)
        tag = page.tags.get(_ORIENTATION)
        shape = page.imagelength, page.imagewidth
        shape = shape[::-1] if tag and int(tag.value) >= 5 else shape
        return frames.Header(shape, depth, pages, times_s, notes=(*notes, *more))


def tiff_numbers(path: Path, number: int) -> tuple[NDArray[Any], int]:
    """Return a page's codes of 16 bits or light, (H, W, channels), upright; kind of alpha, or 0.

    The kind is 1 if colors are multiplied with alpha, 2 if they are not.
    """
    with TiffFile(path) as file:
        page: Any = file.pages[number]
        size = page.imagelength, page.imagewidth, page.samplesperpixel
        check_decoded(path, size, _COPIES * np.dtype(page.dtype).itemsize)
        try:
            numbers = page.asarray()
        except ValueError as problem:
            if "imagecodecs" not in str(problem):
                raise
            content = np.frombuffer(read_bytes(path, ARRAY_BYTES), np.uint8)
            flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
            with frames.without_log():
                _, pages = cv2.imdecodemulti(content, flags, range=(number, number + 1))
            numbers = (
                pages[0] if pages[0].ndim == 2 else pages[0][..., [2, 1, 0, 3][: pages[0].shape[2]]]
            )
        else:
            if page.samplesperpixel > 1 and page.planarconfig == tifffile.PLANARCONFIG.SEPARATE:
                numbers = np.moveaxis(numbers, 0, -1)
        numbers = numbers.reshape(page.imagelength, page.imagewidth, -1)
        if page.photometric == PHOTOMETRIC.MINISWHITE:
            numbers = np.iinfo(numbers.dtype).max - numbers
        colors = _colors(page)
        alpha = next((kind for kind in page.extrasamples if kind in (_ASSOCIATED, STRAIGHT)), 0)
        used = [*range(colors), *([colors + page.extrasamples.index(alpha)] if alpha else [])]
        tag = page.tags.get(_ORIENTATION)
        turn = TURNS.get(int(tag.value) if tag else 1, (False,) * 3)
        return frames.turned(numbers[..., used], *turn), alpha


def profile_left_out(path: Path, profile: bytes) -> Iterator[str]:
    """Yield a note on a color profile that is not that of sRGB."""
    if profile and b"sRGB" not in profile and "sRGB".encode("utf-16-be") not in profile:
        yield f"{path} has a color profile, which is ignored"


def _colors(page: Any) -> int:
    return 3 if page.photometric in (PHOTOMETRIC.RGB, PHOTOMETRIC.YCBCR) else 1


def _kind(page: Any) -> tuple[Any, ...]:
    """Return what frames of one file have in common."""
    return page.keyframe.shape, page.keyframe.dtype, page.keyframe.photometric


def _depth(path: Path, page: Any) -> frames.Depth:
    bits, kind, colors = page.bitspersample, np.dtype(page.dtype).kind, page.photometric
    if colors in (
        PHOTOMETRIC.SEPARATED,
        PHOTOMETRIC.CIELAB,
        PHOTOMETRIC.ICCLAB,
        PHOTOMETRIC.ITULAB,
    ):
        raise DamagedFileError(f"{path} has the colors {colors.name} of prints; save it in sRGB")
    gray_or_rgb = PHOTOMETRIC.MINISBLACK, PHOTOMETRIC.RGB
    plain = (*gray_or_rgb, PHOTOMETRIC.MINISWHITE)
    if bits <= 8 and kind in "ub" and colors in (*plain, PHOTOMETRIC.PALETTE, PHOTOMETRIC.YCBCR):
        return "8 bits"
    if (kind, bits) == ("u", 16) and colors in plain:
        return "16 bits"
    if kind == "f" and colors in gray_or_rgb:
        return "light"
    raise DamagedFileError(
        f"{path} has {bits} bits of {kind} and colors {colors.name}, which are not read; save it "
        "as gray or RGB, of 8 or 16 bits or in float32"
    )


def _imagej(path: Path, file: TiffFile, count: int) -> tuple[tuple[float, ...] | None, list[str]]:
    """Return the times that ImageJ states, s, and notes."""
    if file.is_ome:
        return None, [f"{path} has OME metadata, which are not used"]
    stated = file.imagej_metadata or {}
    notes = [
        f"{path} has {stated[axis]} {axis} of ImageJ, which are read as frames"
        for axis in ("channels", "slices")
        if int(stated.get(axis, 1)) > 1 and count > 1
    ]
    period_s = float(stated.get("finterval", 0)) or 1 / float(stated.get("fps", 0) or np.inf)
    if not (0 < period_s < np.inf) or count == 1:
        return None, notes
    return tuple((period_s * np.arange(count)).tolist()), notes
