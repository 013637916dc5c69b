"""Films read with PyAV: frames at their times, upright, as light.

The suffix fixes the demuxer, which reads an opened file, so that nothing in the file can refer to
another one. libswscale converts to RGB: for 8 bits with full chroma and correct rounding, for more
bits without full chroma, which gives wrong colors there (libswscale 9).
"""

import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from megalopta.core import bounded
from megalopta.core.arrays import Floats, Ints
from megalopta.core.errors import DamagedFileError
from megalopta.core.pictures import PIXEL_BYTES
from megalopta.core.progress import working
from megalopta.render.footage import frames

DEMUXERS: Mapping[str, str] = {
    **dict.fromkeys((".mp4", ".mov", ".m4v"), "mov"),
    **dict.fromkeys((".webm", ".mkv"), "matroska"),
    ".avi": "avi",
}
"""Demuxer by the suffix of the file."""

_REMEDY = "repair it with ffmpeg -i IN OUT.mp4, or copy it again"
_MOST_FRAMES, _MOST_BYTES = 1_000_000, 2 * 10**11
_LIMITED, _FULL = 1, 2
_BT709, _BT601, _BT2020 = 1, 5, 9
_MATRICES = {1: 1, 4: 4, 5: 5, 6: 5, 7: 7, 9: 9}
"""libswscale's number of a color matrix, by that in the file (ITU-T H.273)."""
_TOLD = (
    *("STEREO3D", "SPHERICAL", "MASTERING_DISPLAY_METADATA", "CONTENT_LIGHT_LEVEL"),
    "ICC_PROFILE",
)
"""Data of a frame on place and light without effect."""


class Film(frames.Footage):
    """Frames of a film, decoded on request.

    Raises DamagedFileError; ModuleNotFoundError without PyAV.
    """

    def __init__(self, path: Path) -> None:
        from av.error import FFmpegError
        from av.video.reformatter import VideoReformatter

        bounded.check_file(path, _MOST_BYTES)
        self.path, self._demuxer = path, DEMUXERS[path.suffix.lower()]
        self._problem, self._reformatter = FFmpegError, VideoReformatter()
        self._file = path.open("rb")
        self._container: Any = None
        try:
            with working(f"frames of {path}"):
                self._begin()
                stamps = self._survey()
                self._begin()
            first = self._decoded(0)
            self._kind = first.width, first.height, first.format.name
            self._turn, coding = _turn(first), self._coding(first)
            times_s = np.asarray((stamps - stamps[0]) * float(self._stream.time_base))
            super().__init__(
                path=path,
                files=(path,),
                count=len(stamps),
                shape=(first.width, first.height)[:: 1 if self._turn[0] else -1],
                coding=coding,
                times_s=times_s,
                notes=tuple(self._notes(first, coding, times_s)),
            )
        except FFmpegError as problem:
            self._free()
            raise DamagedFileError(
                f"{path} cannot be read as a video ({problem.strerror}); {_REMEDY}"
            ) from None
        except BaseException:
            self._free()
            raise

    def close(self) -> None:
        """Free the decoder, close the file."""
        super().close()
        self._free()

    @contextmanager
    def opened(self) -> Iterator[BinaryIO]:
        """Give the film's open file from its start on; the decoder then continues in it."""
        with self._decoding:
            place = self._file.tell()
            self._file.seek(0)
            try:
                yield self._file
            finally:
                self._file.seek(place)

    def _free(self) -> None:
        if self._container is not None:
            self._container.close()
        self._file.close()

    def _numbers(self, index: int) -> NDArray[Any]:
        frame = self._decoded(index)
        if (frame.width, frame.height, frame.format.name) != self._kind:
            raise DamagedFileError(
                f"{self.path}: frame {index} differs from the first in size or format; cut it there"
            )
        codes = self._reformatter.reformat(frame, **self._conversion).to_ndarray()
        transposed, mirrored_x, mirrored_y = self._turn
        codes = codes.swapaxes(0, 1) if transposed else codes
        return np.ascontiguousarray(codes[:: -1 if mirrored_y else 1, :: -1 if mirrored_x else 1])

    def _coding(self, first: Any) -> frames.Coding:
        """Find how frames like the first become RGB, and that light."""
        from av.video.reformatter import Interpolation

        components, is_rgb = first.format.components, first.format.is_rgb
        bits = max(component.bits for component in components)
        is_deep, is_gray = bits > 8, len(components) == 1 and not first.format.has_palette
        is_full = first.color_range == _FULL or first.format.name.startswith("yuvj")
        matrix = None if is_rgb else _matrix(self.path, first, is_gray)
        way = Interpolation.BILINEAR | Interpolation.ACCURATE_RND | Interpolation.BITEXACT
        self._conversion: dict[str, Any] = {
            "format": "rgb48le" if is_deep else "rgb24",
            "src_colorspace": matrix,
            "dst_colorspace": matrix,
            "interpolation": way if is_deep else way | Interpolation.FULL_CHR_H_INT,
            "src_color_range": _FULL if is_full or is_rgb else _LIMITED,
            "dst_color_range": _FULL,
        }
        name = frames.TRANSFERS.get(first.color_trc)
        if name is None:
            raise DamagedFileError(
                f"{self.path} has the transfer function {first.color_trc} of H.273, which is not "
                "supported; convert it to BT.709"
            )
        # black and white in libswscale's RGB
        black, white = 0, (2**bits - 1) << (16 - bits) if is_deep else 255
        if is_rgb:
            white = 65535 if is_deep else 255
        elif is_gray:  # treated as full range, whatever is stated
            if first.color_range == _LIMITED:
                black, white = (16 * 256, 235 * 256) if is_deep else (16, 235)
        elif is_deep and not is_full:
            white = 65283  # as libswscale makes of limited range
        coding = frames.coding_of(name, 65536 if is_deep else 256, black, white)
        _, xy = frames.PRIMARIES.get(first.color_primaries, frames.PRIMARIES[1])
        return replace(coding, matrix=frames.to_bt709(xy))

    def _begin(self) -> None:
        import av

        if self._container is not None:
            self._container.close()
        self._file.seek(0)
        # Titles may be in any encoding, which PyAV allows by itself from 19 on.
        lenient = {"metadata_errors": "replace"} if int(av.__version__.split(".")[0]) < 19 else {}
        self._container = av.open(
            self._file, "r", format=self._demuxer, buffer_size=2**20, **lenient
        )
        film = self._container.streams.best("video")
        if film is None or "attached_pic" in str(film.disposition):
            raise DamagedFileError(f"{self.path} has only sound; give a video")
        codec = film.codec_context
        if codec is None:
            raise DamagedFileError(f"{self.path} has an unknown codec; {_REMEDY}")
        frames.check_size(self.path, (codec.height, codec.width))
        most = int(min(bounded.budget_bytes() / PIXEL_BYTES, 2**31 - 1))
        codec.options = {"max_pixels": str(most)}
        film.thread_type = "AUTO"
        self._stream: Any = film
        self._next, self._frames = 0, self._container.decode(film)

    def _survey(self) -> Ints:
        """Return the times of all frames in units of the stream, from packets alone."""
        is_avi, known = self._demuxer == "avi", list[int | None]()
        packets = 0
        for packet in self._container.demux(self._stream):
            if packet.has_sidedata("encryption_info") or packet.has_sidedata(
                "encryption_init_info"
            ):
                raise DamagedFileError(f"{self.path} is encrypted; give a copy without protection")
            if packet.is_corrupt:
                raise DamagedFileError(f"{self.path} ends too early or is damaged; {_REMEDY}")
            is_hidden = packet.is_discard
            if packet.size and packet.stream.codec_context.name == "vp8":
                is_hidden |= not bytes(packet)[0] & 0x10  # a frame used only to predict others
            packets += 1
            if packet.size and not is_hidden:
                # AVI has no times for pictures that are decoded in another order than shown.
                known.append(packet.dts if is_avi else packet.pts)
            bounded.check_count(self.path, "frames", len(known), _MOST_FRAMES)
        if not known:
            raise DamagedFileError(f"{self.path} has no frame that can be read; {_REMEDY}")
        stated = 0 if is_avi else self._stream.frames  # AVI counts omitted frames, too
        packets -= 1  # the last one ends the film
        if packets < stated:
            raise DamagedFileError(
                f"{self.path} ends too early, with {packets} of {stated} frames; {_REMEDY}"
            )
        stamps = [stamp for stamp in known if stamp is not None]
        self._counts = is_avi or len(stamps) < len(known)
        self._stamps: Ints = np.unique(stamps)
        if len(stamps) < len(known):
            rate, base = self._stream.average_rate, self._stream.time_base
            if not rate or not base:
                raise DamagedFileError(f"{self.path} has no times of its frames; {_REMEDY}")
            self._stamps = np.array([round(k / rate / base) for k in range(len(known))], np.int64)
        return self._stamps

    def _notes(self, first: Any, coding: frames.Coding, times_s: Floats) -> Iterator[str]:
        primaries = first.color_primaries
        if first.color_trc == frames.UNSTATED:
            yield f"{self.path} does not state its transfer function; that of BT.709 is used"
        if coding.name in frames.HDR_NOTES:
            yield frames.HDR_NOTES[coding.name]
        if coding.matrix is not None:
            name, _ = frames.PRIMARIES[primaries]
            yield f"colors of {name} are converted to sRGB; channels outside its gamut become 0"
        if primaries not in (frames.UNSTATED, *frames.PRIMARIES):
            yield (
                f"{self.path} has the primaries {primaries} of H.273, which are unknown; those of "
                "BT.709 are used"
            )
        if any(self._turn):
            degrees = first.rotation % 360
            yield f"frames are turned as stated by {self.path}, by {degrees}° to the left"
        if any(component.is_alpha for component in first.format.components):
            yield f"the transparency of {self.path} is ignored"
        names = [first.side_data[i].type.name for i in range(len(first.side_data))]
        yield from frames.unused(self.path, {name: "" for name in names if name in _TOLD})
        if first.interlaced_frame:
            yield f"{self.path} is interlaced: each frame holds two moments; deinterlace it first"
        if (streams := len(self._container.streams.video)) > 1:
            yield f"{self.path} holds {streams} films or pictures; one is read"
        if self._stream.sample_aspect_ratio:
            yield from frames.not_square(self.path, float(self._stream.sample_aspect_ratio))
        ends_s = (self._container.duration or 0) / 1e6
        if ends_s > times_s[-1] + 1 + 2 * np.diff(times_s, prepend=0).max():
            yield (
                f"{self.path} promises {ends_s:.1f} s, but its frames end at {times_s[-1]:.1f} s: "
                "it may be truncated, or only its sound continues"
            )

    def _decoded(self, index: int) -> Any:
        """Return a decoded frame. Raises DamagedFileError if it is damaged or missing."""
        is_next = self._next <= index <= self._next + 50  # frames decoded rather than jumped over
        for begins_anew in (self._counts and not is_next, True):
            with suppress(self._problem):
                if begins_anew:
                    self._begin()
                elif not is_next:  # go to the picture from which the frame is predicted
                    self._container.seek(int(self._stamps[index]), stream=self._stream)
                    self._frames = self._container.decode(self._stream)
                frame = self._decoded_to(index)
                if frame is not None and not frame.is_corrupt:
                    return frame
        raise DamagedFileError(f"{self.path}: frame {index} cannot be decoded; {_REMEDY}")

    def _decoded_to(self, index: int) -> Any:
        """Return a frame further on; None if it is not there."""
        for frame in self._frames:
            number = self._next
            if not self._counts:
                stamp = self._stamps[0] - 1 if frame.pts is None else frame.pts
                number = int(np.searchsorted(self._stamps, stamp))
                if number == len(self._stamps) or self._stamps[number] != stamp:
                    continue
            self._next = number + 1
            if number >= index:
                return frame if number == index else None
        return None


def _matrix(path: Path, frame: Any, is_gray: bool) -> int:
    """Number in libswscale of the matrix between Y'CbCr and RGB. Raises DamagedFileError."""
    stated = frame.colorspace
    if stated in _MATRICES or is_gray:
        return _MATRICES.get(stated, _BT709)
    if stated != frames.UNSTATED:
        raise DamagedFileError(
            f"{path} has the color matrix {stated} of H.273, which is not supported; "
            "convert it to BT.709"
        )
    if frame.color_primaries == _BT2020:
        return _BT2020
    return _BT709 if min(frame.width, frame.height) >= 720 else _BT601  # rows of HD


def _turn(frame: Any) -> tuple[bool, bool, bool]:
    """True if a frame's display matrix transposes it, then mirrors x, and y."""
    from av.sidedata.sidedata import Type

    matrix = frame.side_data.get(Type.DISPLAYMATRIX)
    if matrix is None:
        return False, False, False
    a, b, _, c, d = struct.unpack_from("=5i", bytes(matrix))
    if abs(a) + abs(d) >= abs(b) + abs(c):
        return False, a < 0, d < 0
    return True, c < 0, b < 0
