"""Headerless files of packed frames, one or a folder of them in the order of their names."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.sensor.formats.layout import PackedLayout
from megalopta.sensor.formats.recorded_frames import file_bytes, wanted

_FOOTER = b"DONE"
"""Sent by the SPAD512S after its frames, and kept by programs that write all they receive."""


def raw_frames(
    path: Path, frame_bytes: int, layout: PackedLayout, first: int, frames: int | None
) -> NDArray[np.uint8]:
    """Frames of a file or of the `.bin` files of a folder, (T, frame_bytes).

    Raises
    ------
    FileNotFoundError
        When there is nothing.
    ValueError
        When a file is no whole number of frames.
    """
    files = sorted(path.glob("*.bin")) if path.is_dir() else [path]
    if not files:
        raise FileNotFoundError(f"{path}: no .bin files in this folder; give that of a recording")
    parts = [_body(file, frame_bytes, layout) for file in files]
    range_ = wanted(sum(map(len, parts)), first, frames, path)
    return _joined(parts, range_, frame_bytes)


def _body(path: Path, frame_bytes: int, layout: PackedLayout) -> NDArray[np.uint8]:
    content = file_bytes(path)
    body = content[layout.header_bytes : content.size - layout.footer_bytes]
    if body.size % frame_bytes == len(_FOOTER) and body[-len(_FOOTER) :].tobytes() == _FOOTER:
        body = body[: -len(_FOOTER)]
    if body.size == 0 or body.size % frame_bytes:
        raise ValueError(
            f"{path}: {body.size} bytes are no whole number of frames of {frame_bytes}; it is cut "
            "short or of another format, or give header_bytes and footer_bytes"
        )
    return body.reshape(-1, frame_bytes)


def _joined(
    parts: Sequence[NDArray[np.uint8]], range_: slice, frame_bytes: int
) -> NDArray[np.uint8]:
    chosen, start = [np.empty((0, frame_bytes), np.uint8)], 0
    for part in parts:
        chosen.append(part[max(range_.start - start, 0) : max(range_.stop - start, 0)])
        start += len(part)
    return np.concatenate(chosen)
