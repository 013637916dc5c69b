"""How binary frames are packed into bytes, eight pixels each, and back."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from megalopta.sensor.formats.bit_order import is_packed_along_height, is_reversed

Bytes = NDArray[np.uint8]


class PackedLayout(BaseModel, frozen=True, extra="forbid", use_attribute_docstrings=True):
    """Of files that do not say it themselves. An image is turned first, then flipped."""

    bit_order: Literal["msb", "lsb", "auto"] = "msb"
    """Which bit of a byte is the first pixel: the most or the least significant; `auto` takes the
    other one than `msb` where the image says so."""

    packed_along: Literal["width", "height"] = "width"
    """Whether a byte holds eight pixels of a row or of a column."""

    header_bytes: Annotated[int, Field(ge=0)] = 0
    """Left out at the beginning of every file."""

    footer_bytes: Annotated[int, Field(ge=0)] = 0
    """Left out at the end of every file."""

    transposed: bool = False
    """Rows and columns are exchanged."""

    flipped_rows: bool = False
    """The image is upside down."""

    flipped_columns: bool = False
    """Left and right are exchanged."""

    is_checked: bool = True
    """Refuse frames in which neighbors across the borders of bytes do not fit."""


def pack(bits: Bytes) -> Bytes:
    """Pack bits, 0 or 1, (…, W) along the width, most significant first: (…, ceil(W/8))."""
    return np.packbits(bits, axis=-1)


def unpack_frames(packed: Bytes, layout: PackedLayout, path: Path, width: int | None) -> Bytes:
    """Bits, 0 or 1, (T, H, W), of packed frames (T, H, W/8), or (T, H/8, W).

    Parameters
    ----------
    packed : (T, H, W/8) or (T, H/8, W) uint8
    layout : PackedLayout
    path : Path
        For what is told of a mistake.
    width : int or None
        Pixels along the packed axis, if they are not a multiple of eight.

    Raises
    ------
    ValueError
        When the layout is another, by the look of the image.
    """
    along = 2 if layout.packed_along == "width" else 1
    order: Literal["big", "little"] = "little" if layout.bit_order == "lsb" else "big"
    bits = np.unpackbits(packed, axis=along, count=width, bitorder=order)
    if layout.is_checked and bits.size:
        bits = _checked(bits, packed, layout, path, width)
    return _turned(bits, layout)


def _checked(
    bits: Bytes, packed: Bytes, layout: PackedLayout, path: Path, width: int | None
) -> Bytes:
    along = 2 if layout.packed_along == "width" else 1
    if along == 2 and is_packed_along_height(packed):
        raise ValueError(
            f"{path}: neighbors do not fit, as if transposed: bytes seem to hold eight pixels of a "
            "column; give packed_along 'height', or is_checked false"
        )
    if is_reversed(bits if along == 2 else np.swapaxes(bits, 1, 2)):
        if layout.bit_order == "auto":
            return np.unpackbits(packed, axis=along, count=width, bitorder="little")
        other = "lsb" if layout.bit_order == "msb" else "msb"
        raise ValueError(
            f"{path}: the mean by pixel column has a period of 8, so bits are probably reversed; "
            f"give bit_order '{other}' (or 'auto'), or is_checked false"
        )
    return bits


def _turned(bits: Bytes, layout: PackedLayout) -> Bytes:
    image = np.swapaxes(bits, 1, 2) if layout.transposed else bits
    image = image[:, ::-1] if layout.flipped_rows else image
    return image[:, :, ::-1] if layout.flipped_columns else image
