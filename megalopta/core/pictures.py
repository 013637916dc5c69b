"""Read pictures as arrays, write arrays as PNG. Every folder may import this module."""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from megalopta.core.bounded import ARRAY_BYTES, check_file, read_bytes
from megalopta.core.errors import DamagedFileError
from megalopta.core.files import atomic_write

_FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "PPM", "WEBP", "GIF")
"""Pillow passes some other formats, such as PostScript, to programs that run code in the file."""


def read_codes(path: Path, mode: Literal["L", "RGB"]) -> NDArray[np.uint8]:
    """Return an 8-bit picture, gray (H, W) or in color (H, W, 3).

    Raises DamagedFileError if it is no picture, has more than 8 bits, or claims more pixels than
    Pillow trusts.
    """
    with opened_picture(path) as image:
        if image.mode[0] in "IF":
            raise DamagedFileError(f"{path} has more than 8 bits; save it with 8")
        return np.asarray(image.convert(mode))


@contextmanager
def opened_picture(path: Path) -> Iterator[Image.Image]:
    """Open a picture for Pillow to decode; errors as `readable`, also during decoding inside."""
    with readable(path):
        check_file(path)
        with decoded(path, path) as image:
            yield image


@contextmanager
def decoded(file: Path | BinaryIO, name: object) -> Iterator[Image.Image]:
    """Open a file for Pillow to decode, as `opened_picture`; its name is for messages."""
    with readable(name), _opened(file) as image:
        yield image


def _opened(file: Path | BinaryIO) -> Image.Image:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what matters raises an exception
        return Image.open(file, formats=_FORMATS)


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
        raise DamagedFileError(f"{path} cannot be read as a picture; give a PNG") from None


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
