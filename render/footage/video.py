"""Videos read with PyAV: frames at their times, upright, as light.

libswscale converts to RGB: for 8 bits with full chroma and correct rounding, for more bits without
full chroma, which gives wrong colors there (libswscale 9); white is then the code `_DEEP_WHITE`.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from megalopta.core.errors import DamagedFileError
from megalopta.render.footage.film_reader import REMEDY, FilmReader
from megalopta.render.footage.frames import Coding, Footage, coding_of, turned, unused
from megalopta.render.footage.transfer import (
    HDR_NOTES,
    PRIMARIES,
    TRANSFERS,
    UNSTATED,
    to_bt709,
)

if TYPE_CHECKING:
    from av.video.frame import VideoFrame

_LIMITED, _FULL = 1, 2
_DEEP_WHITE = 65283
"""Code of white in the 16-bit RGB that libswscale makes of limited range."""
_BT709_MATRIX, _BT601_MATRIX, _BT2020_MATRIX = 1, 5, 9
_MATRICES = {1: 1, 4: 4, 5: 5, 6: 5, 7: 7, 9: 9}
"""libswscale's number of a color matrix, by that in the file (ITU-T H.273)."""
_BT2020_PRIMARIES = 9
_TOLD = (
    *("STEREO3D", "SPHERICAL", "MASTERING_DISPLAY_METADATA", "CONTENT_LIGHT_LEVEL"),
    "ICC_PROFILE",
)
"""Data of a frame on place and light without effect."""
_HD_ROWS = 720
"""Rows from which a video without a stated matrix uses that of BT.709, not of BT.601."""


@dataclass(eq=False, kw_only=True)
class Video(Footage):
    """Frames of a video, decoded on request."""

    reader: FilmReader
    conversion: "_Conversion"

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.reader.stamps)

    def close(self) -> None:
        """Free the decoder, close the file."""
        super().close()
        self.reader.close()

    def _numbers(self, index: int) -> NDArray[Any]:
        frame = self.reader.frame(index)
        if frame is None:
            raise DamagedFileError(f"{self.path}: frame {index} cannot be decoded; {REMEDY}")
        if not self.conversion.fits(frame):
            raise DamagedFileError(
                f"{self.path}: frame {index} differs from the first in size or format; cut it there"
            )
        return self.conversion.codes(frame)


def open_video(path: Path) -> Video:
    """Return a video as footage. Raises DamagedFileError; ModuleNotFoundError without PyAV."""
    reader = FilmReader(path)
    try:
        first = reader.frame(0)
        if first is None:
            raise DamagedFileError(f"{path}: no frame can be decoded; {REMEDY}")
        conversion = _Conversion(path, first)
        return Video(
            path=path,
            files=(path,),
            shape=conversion.shape,
            coding=conversion.coding,
            times_s=reader.times_s,
            notes=(*conversion.notes(), *reader.notes()),
            reader=reader,
            conversion=conversion,
        )
    except BaseException:
        reader.close()
        raise


class _Conversion:
    """Conversion of decoded frames like the first to RGB codes, upright, and to light."""

    def __init__(self, path: Path, first: "VideoFrame") -> None:
        from av.video.reformatter import VideoReformatter

        self._path, self._first, self._reformatter = path, first, VideoReformatter()
        self._bits = max(each.bits for each in first.format.components)
        self._is_rgb = first.format.is_rgb
        self._is_gray = len(first.format.components) == 1 and not first.format.has_palette
        self._is_full = first.color_range == _FULL or first.format.name.startswith("yuvj")
        self._turn = _display_turn(first)
        rows, columns = first.height, first.width
        self.shape = (columns, rows) if self._turn[0] else (rows, columns)
        self.coding = self._coding()

    def fits(self, frame: "VideoFrame") -> bool:
        """True if a frame has the size and format of the first."""
        first = self._first
        return (frame.width, frame.height, frame.format.name) == (
            first.width,
            first.height,
            first.format.name,
        )

    def codes(self, frame: "VideoFrame") -> NDArray[Any]:
        """Return codes (H, W, 3), of 8 or 16 bits."""
        from av.video.reformatter import Interpolation as Way

        way = Way.BILINEAR | Way.ACCURATE_RND | Way.BITEXACT
        converted = self._reformatter.reformat(
            frame,
            format="rgb48le" if self._bits > 8 else "rgb24",
            src_colorspace=None if self._is_rgb else self._matrix(),
            dst_colorspace=None if self._is_rgb else self._matrix(),
            interpolation=way if self._bits > 8 else way | Way.FULL_CHR_H_INT,
            src_color_range=_FULL if self._is_full or self._is_rgb else _LIMITED,
            dst_color_range=_FULL,
        )
        return turned(converted.to_ndarray(), *self._turn)

    def notes(self) -> Iterator[str]:
        """Yield notes on assumptions and changes."""
        first, path = self._first, self._path
        if first.color_trc == UNSTATED:
            yield f"{path} does not state its transfer function; that of BT.709 is used"
        if self.coding.name in HDR_NOTES:
            yield HDR_NOTES[self.coding.name]
        if self.coding.matrix is not None:
            name, _ = PRIMARIES[first.color_primaries]
            yield f"colors of {name} are converted to sRGB; channels outside its gamut become 0"
        if first.color_primaries not in (UNSTATED, *PRIMARIES):
            yield (
                f"{path} has the primaries {first.color_primaries} of H.273, which are unknown; "
                "those of BT.709 are used"
            )
        if any(self._turn):
            yield f"frames are turned as stated by {path}, by {first.rotation % 360}° to the left"
        if any(each.is_alpha for each in first.format.components):
            yield f"the transparency of {path} is ignored"
        side_data: Any = first.side_data
        names = [each.type.name for each in side_data]
        yield from unused(path, {name: "" for name in names if name in _TOLD})
        if first.interlaced_frame:
            yield f"{path} is interlaced: each frame holds two moments; deinterlace it first"

    def _coding(self) -> Coding:
        first = self._first
        name = TRANSFERS.get(first.color_trc)
        if name is None:
            raise DamagedFileError(
                f"{self._path} has the transfer function {first.color_trc} of H.273, which is not "
                "supported; convert it to BT.709"
            )
        self._matrix()
        coding = coding_of(name, 65536 if self._bits > 8 else 256, *self._black_and_white())
        _, primaries = PRIMARIES.get(first.color_primaries, PRIMARIES[1])
        return replace(coding, matrix=to_bt709(primaries))

    def _black_and_white(self) -> tuple[int, int]:
        """Codes of black and white in libswscale's RGB."""
        deep = self._bits > 8
        if self._is_rgb:
            return 0, 65535 if deep else 255
        top = (2**self._bits - 1) << (16 - self._bits) if deep else 255
        if self._is_gray:  # treated as full range, whatever is stated
            unit = 256 if deep else 1
            is_limited = self._first.color_range == _LIMITED
            return (16 * unit, 235 * unit) if is_limited else (0, top)
        return 0, _DEEP_WHITE if deep and not self._is_full else top

    def _matrix(self) -> int:
        """Number in libswscale of the matrix between Y'CbCr and RGB. Raises DamagedFileError."""
        stated = self._first.colorspace
        if stated in _MATRICES or self._is_rgb or self._is_gray:
            return _MATRICES.get(stated, _BT709_MATRIX)
        if stated != UNSTATED:
            raise DamagedFileError(
                f"{self._path} has the color matrix {stated} of H.273, which is not supported; "
                "convert it to BT.709"
            )
        if self._first.color_primaries == _BT2020_PRIMARIES:
            return _BT2020_MATRIX
        return _BT709_MATRIX if min(self.shape) >= _HD_ROWS else _BT601_MATRIX


def _display_turn(frame: "VideoFrame") -> tuple[bool, bool, bool]:
    """Return the arguments of `turned` that follow a frame's display matrix."""
    from av.sidedata.sidedata import Type

    side_data: Any = frame.side_data
    found = side_data.get(Type.DISPLAYMATRIX)
    if found is None:
        return False, False, False
    a, b, _, c, d = struct.unpack_from("=5i", bytes(found))
    if abs(a) + abs(d) >= abs(b) + abs(c):
        return False, a < 0, d < 0
    return True, c < 0, b < 0
