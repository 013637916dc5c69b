"""Frames of a video in order, with their times, decoded by PyAV.

The suffix fixes the demuxer, which reads an opened file, so that nothing in the file can refer to
another one. Number and times of frames come from the packets, without decoding; every decoded frame
is checked against them.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import budget_bytes, check_count, check_file
from megalopta.core.errors import DamagedFileError
from megalopta.core.pictures import PIXEL_BYTES
from megalopta.core.progress import working
from megalopta.render.footage.frames import check_size, not_square

if TYPE_CHECKING:
    from av.video.frame import VideoFrame

DEMUXERS: Mapping[str, str] = {
    **dict.fromkeys((".mp4", ".mov", ".m4v"), "mov"),
    **dict.fromkeys((".webm", ".mkv"), "matroska"),
    **dict.fromkeys((".avi",), "avi"),
}
"""Demuxer by the suffix of the file."""

REMEDY = "repair it with ffmpeg -i IN OUT.mp4, or copy it again"
_MOST_FRAMES, _MOST_BYTES = 1_000_000, 2 * 10**11
_ENCRYPTED = ("encryption_info", "encryption_init_info")


class FilmReader:
    """Decoder: `stamps` are the times of all frames, in units of the stream, increasing."""

    def __init__(self, path: Path) -> None:
        self._path, self._is_avi = path, DEMUXERS[path.suffix.lower()] == "avi"
        self._parted = 0
        self._file: BinaryIO | None = None
        self._open()
        try:
            with working(f"frames of {path}"), _told(path):
                self._survey()
            self._rewind()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Free the decoder, close the file."""
        if self._file is not None:
            self._container.close()
            self._file.close()
            self._file = None

    @cached_property
    def times_s(self) -> Floats:
        """Times of all frames (s); the first is 0."""
        base_s = float(self._stream.time_base)
        return np.asarray((self.stamps - self.stamps[0]) * base_s)

    def notes(self) -> Iterator[str]:
        """Yield notes on the frames for the user."""
        if (streams := len(self._container.streams.video)) > 1:
            yield f"{self._path} holds {streams} films or pictures; one is read"
        if self._stream.sample_aspect_ratio:
            yield from not_square(self._path, float(self._stream.sample_aspect_ratio))
        if self._parted:
            yield (
                f"{self._path} is cut within a group of frames: the first {self._parted} cannot be "
                "decoded and are omitted"
            )
        ends_s = (self._container.duration or 0) / 1e6
        last_s = self.times_s[-1]
        if ends_s > last_s + 1 + 2 * np.diff(self.times_s, prepend=0).max():
            yield (
                f"{self._path} promises {ends_s:.1f} s, but its frames end at {last_s:.1f} s: it "
                "may be truncated, or only its sound continues"
            )

    def frame(self, index: int) -> "VideoFrame | None":
        """Return a decoded frame; None if it is damaged or missing."""
        for go in self._ways(index):
            go(index)
            frame = self._decode_to(index)
            if frame is not None and not frame.is_corrupt:
                return frame
        return None

    def _ways(self, index: int) -> Iterator[Callable[[int], None]]:
        """Yield methods of seeking to before a frame, the fastest first."""
        key = self._keys[np.searchsorted(self._keys, index, "right") - 1]
        if key <= self._next <= index:
            yield lambda _: None
        elif key and not self._counts:
            yield self._seek
        if self._next or self._is_moved:
            yield self._rewind

    def _decode_to(self, index: int) -> "VideoFrame | None":
        try:
            for at, frame in self._decoded:
                self._next = at + 1
                if at >= index:
                    return frame if at == index else None
        except _av_error():
            return None
        return None

    def _seek(self, index: int) -> None:
        key = self._keys[np.searchsorted(self._keys, index, "right") - 1]
        try:
            self._container.seek(int(self.stamps[key]), stream=self._stream)
        except _av_error():
            return
        self._start(int(key))
        self._is_moved = True

    def _rewind(self, _: int = 0) -> None:
        self.close()
        self._open()
        self._start(0)
        self._is_moved = False

    def _start(self, index: int) -> None:
        self._next = index
        self._decoded: Iterator[tuple[int, VideoFrame]] = self._numbered()

    def _numbered(self) -> Iterator[tuple[int, "VideoFrame"]]:
        """Yield frames with their numbers, counted or derived from their times."""
        for count, frame in enumerate(self._container.decode(self._stream)):
            at = count
            if not self._counts:
                stamp = self.stamps[0] - 1 if frame.pts is None else frame.pts
                at = int(np.searchsorted(self.stamps, stamp))
                if at == len(self.stamps) or self.stamps[at] != stamp:
                    continue
            yield at, frame

    def _open(self) -> None:
        import av

        path = self._path
        check_file(path, _MOST_BYTES)
        self._file = path.open("rb")
        try:
            with _told(path):
                self._container: Any = av.open(
                    self._file,
                    "r",
                    format=DEMUXERS[path.suffix.lower()],
                    buffer_size=2**20,
                    metadata_errors="replace",  # titles may be in any encoding
                )
                self._stream = self._film()
                self._stream.thread_type = "AUTO"
        except BaseException:
            self._file.close()
            self._file = None
            raise

    def _film(self) -> Any:
        film = self._container.streams.best("video")
        if film is None or "attached_pic" in str(film.disposition):
            raise DamagedFileError(f"{self._path} has only sound; give a video")
        if film.codec_context is None:
            raise DamagedFileError(f"{self._path} has a codec that cannot be decoded; {REMEDY}")
        check_size(self._path, (film.codec_context.height, film.codec_context.width))
        film.codec_context.options = {
            "max_pixels": str(int(min(budget_bytes() / PIXEL_BYTES, 2**31 - 1)))
        }
        return film

    def _survey(self) -> None:
        packets = []
        for packet in self._container.demux(self._stream):
            packets.append(_told_packet(self._path, packet))
            check_count(self._path, "frames", len(packets), _MOST_FRAMES)
        shown = [each for each in packets if each.is_shown]
        self._check_whole(len(packets) - 1, len(shown))  # the last one ends the video
        # AVI has no times for pictures that are decoded in another order than shown.
        self._counts = any(p.shown_at is None for p in shown) or self._is_avi
        stamps = [p.decoded_at if self._counts else p.shown_at for p in shown]
        known = [each for each in stamps if each is not None]
        self.stamps: Ints = np.unique(known) if len(known) == len(shown) else self._even(len(shown))
        self._keys: Ints = np.array([0])
        if not self._counts:
            self._start_whole(np.array([p.shown_at for p in shown if p.is_key], np.int64))

    def _start_whole(self, keys: Ints) -> None:
        """Omit frames that a cut separated from the picture that predicts them."""
        first = int(np.searchsorted(self.stamps, keys[0])) if len(keys) else 0
        self.stamps, self._parted = self.stamps[first:], first
        self._keys = np.union1d([0], np.searchsorted(self.stamps, keys))

    def _check_whole(self, packets: int, shown: int) -> None:
        if not shown:
            raise DamagedFileError(f"{self._path} has no frame that can be read; {REMEDY}")
        stated = 0 if self._is_avi else self._stream.frames  # AVI counts omitted frames, too
        if packets < stated:
            raise DamagedFileError(
                f"{self._path} ends too early, with {packets} of {stated} frames; {REMEDY}"
            )

    def _even(self, count: int) -> Ints:
        rate, base = self._stream.average_rate, self._stream.time_base
        if not rate or not base:
            raise DamagedFileError(f"{self._path} has no times of its frames; {REMEDY}")
        return np.array([round(k / rate / base) for k in range(count)], np.int64)


class _Packet(NamedTuple):
    shown_at: int | None
    decoded_at: int | None
    is_key: bool
    is_shown: bool


def _told_packet(path: Path, packet: Any) -> _Packet:
    """Return a packet's information on its frame. Raises DamagedFileError if it is unusable."""
    if any(packet.has_sidedata(each) for each in _ENCRYPTED):
        raise DamagedFileError(f"{path} is encrypted; give a copy without protection")
    if packet.is_corrupt:
        raise DamagedFileError(f"{path} ends too early or is damaged; {REMEDY}")
    is_hidden = packet.is_discard
    if packet.size and packet.stream.codec_context.name == "vp8":
        is_hidden |= not bytes(packet)[0] & 0x10  # a frame used only to predict others
    is_shown = bool(packet.size) and not is_hidden
    return _Packet(packet.pts, packet.dts, packet.is_keyframe, is_shown)


@contextmanager
def _told(path: Path) -> Iterator[None]:
    try:
        yield
    except _av_error() as problem:
        raise DamagedFileError(
            f"{path} cannot be read as a video ({problem.strerror}); {REMEDY}"
        ) from None


def _av_error() -> type[Any]:
    from av.error import FFmpegError

    return FFmpegError
