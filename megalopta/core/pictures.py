"""Read pictures as arrays, write arrays as PNG. Every folder may import this module."""

import io
import re
import struct
import warnings
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from megalopta.core.bounded import ARRAY_BYTES, check_decoded, check_file, read_bytes
from megalopta.core.errors import DamagedFileError
from megalopta.core.files import atomic_write

_FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "PPM", "WEBP", "GIF")
"""Pillow passes some other formats, such as PostScript, to programs that run code in the file."""
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PIXEL_BYTES = 30
"""Memory of a pixel while a picture is read (bytes, measured)."""
SENSED_BYTES = 120
"""The same while sensors are exposed to it."""


def read_codes(path: Path, mode: Literal["L", "RGB"]) -> NDArray[np.uint8]:
    """Return an 8-bit picture, gray (H, W) or in color (H, W, 3).

    Raises DamagedFileError if it is no picture, has more than 8 bits, or claims more pixels than
    Pillow trusts.
    """
    with opened_picture(path, pixel_bytes=100) as image:  # light, flow and errors follow from it
        if image.mode[0] in "IF":
            raise DamagedFileError(f"{path} has more than 8 bits; save it with 8")
        return np.asarray(image.convert(mode))


@contextmanager
def opened_picture(path: Path, pixel_bytes: float = PIXEL_BYTES) -> Iterator[Image.Image]:
    """Open a picture for Pillow to decode; errors as `decoded`, also during decoding inside."""
    with readable(path):
        check_file(path)
        with path.open("rb") as file, decoded(file, path, pixel_bytes) as image:
            yield image


@contextmanager
def decoded(
    file: BinaryIO, name: object, pixel_bytes: float = PIXEL_BYTES
) -> Iterator[Image.Image]:
    """Open a file for Pillow to decode if its pixels, each of some bytes, fit into the budget.

    Its name is for messages. Errors as `readable`.
    """
    with readable(name):
        beginning = file.read(30)
        file.seek(0)
        if beginning[8:16] == b"WEBPVP8L":  # of which Pillow allocates the pixels at once
            sides = int.from_bytes(beginning[21:25], "little")
            check_decoded(name, ((sides >> 14 & 16383) + 1, (sides & 16383) + 1), pixel_bytes)
        elif beginning[8:16] == b"WEBPVP8X":
            sizes = (int.from_bytes(beginning[at : at + 3], "little") + 1 for at in (27, 24))
            check_decoded(name, sizes, pixel_bytes)
        elif beginning.startswith(PNG_SIGNATURE):
            check_decoded(name, (file.seek(0, io.SEEK_END),), 2)
            file.seek(0)
            file = io.BytesIO(checked_png(file.read()))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what matters raises an exception
            image = Image.open(file, formats=_FORMATS)
        with image:
            check_decoded(name, image.size[::-1], pixel_bytes)
            yield image


def png_parts(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield names and parts of a PNG file, whole, with their checksums. Raises ValueError."""
    if not content.startswith(PNG_SIGNATURE):
        raise ValueError("no PNG file")
    at, name = len(PNG_SIGNATURE), b""
    while name != b"IEND":
        length, name = struct.unpack_from(">I4s", content, at)
        part = content[at : at + length + 12]
        if len(part) < length + 12 or part[-4:] != struct.pack(">I", zlib.crc32(part[4:-4])):
            raise ValueError(f"part {name!r} is damaged")
        yield name, part
        at += length + 12


def checked_png(content: bytes, kept: Collection[bytes] = ()) -> bytes:
    """Return a PNG file of parts of some names, or all; errors as `png_parts`."""
    parts = [part for name, part in png_parts(content) if not kept or name in kept]
    return b"".join([PNG_SIGNATURE, *parts])


@contextmanager
def readable(path: object) -> Iterator[None]:
    """Refuse pictures that cannot be decoded inside, or claim more pixels than Pillow trusts.

    Raises DamagedFileError.
    """
    try:
        yield
    except DamagedFileError:
        raise
    except Image.DecompressionBombError:
        raise DamagedFileError(f"{path} claims too many pixels; give a smaller picture") from None
    except Exception:  # a damaged file can raise any exception
        raise DamagedFileError(
            f"{path} cannot be read as a picture, or ends early; save it again"
        ) from None


_PFM_HEADER = re.compile(rb"P([Ff])\s+(\d{1,6})\s+(\d{1,6})\s+(-?[0-9.eE+-]{1,20})\s")


def read_pfm(path: Path) -> NDArray[np.float32]:
    """Return a portable float map, (H, W) or (H, W, 3), from the top.

    Its scale states the order of bytes by its sign, and a factor of the values. Raises ValueError
    if it is damaged.
    """
    content = read_bytes(path, ARRAY_BYTES)
    header = _PFM_HEADER.match(content)
    scale = float(header[4]) if header else 0.0
    if header is None or not 0 < abs(scale) < np.inf:
        raise ValueError(f"{path} is not a .pfm file (PF or Pf, width, height, scale)")
    width, height, channels = int(header[2]), int(header[3]), 3 if header[1] == b"F" else 1
    check_decoded(path, (height, width, channels), PIXEL_BYTES)
    size, expected = len(content) - header.end(), 4 * channels * width * height
    if size != expected:
        raise ValueError(
            f"{path} has {size} bytes of values, {width} × {height} px need {expected}: the file is"
            " damaged"
        )
    values = np.frombuffer(content, "<f4" if scale < 0 else ">f4", offset=header.end())
    rows = values.reshape(height, width, channels)[::-1] * np.float32(abs(scale))
    return rows[..., 0] if channels == 1 else rows


def write_codes(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write codes of 8 or 16 bits, gray (H, W) or red, green and blue (H, W, 3), as PNG."""
    import cv2  # takes a while to load

    coded = cv2.imencode(".png", image[..., ::-1] if image.ndim == 3 else image)[1]
    with atomic_write(path) as temporary:
        temporary.write_bytes(coded.tobytes())
