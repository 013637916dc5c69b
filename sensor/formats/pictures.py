"""Folders of pictures, a frame each, in the order of the numbers in their names."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import check_count
from megalopta.core.errors import DamagedFileError
from megalopta.core.pictures import opened_picture
from megalopta.sensor.formats.conditions import Conditions, conditions_in
from megalopta.sensor.formats.recorded_frames import Stack, file_bytes, opened_tiff, parts_in

Kind: TypeAlias = Literal["png", "tiff"]
SUFFIXES: dict[Kind, tuple[str, ...]] = {"png": (".png",), "tiff": (".tif", ".tiff")}


@contextmanager
def opened(path: Path, kind: Kind) -> Iterator[Stack]:
    """Open a stack in TIFF, or gray PNG of 1, 8 or 16 bits, or TIFF, which are decoded as read.

    Raises FileNotFoundError for a folder without any; ValueError if one is a link, in color,
    damaged or of another size.
    """
    files = parts_in(path, *SUFFIXES[kind])
    check_count(path, "pictures", len(files), 10**6)
    if not files:
        raise FileNotFoundError(f"{path}: no {kind} in this folder; give that of a recording")
    if kind == "tiff" and len(files) == 1:
        with opened_tiff(files[0]) as stack:
            yield stack
        return
    first, conditions = _decoded(files[0], kind)

    def read(part: slice) -> NDArray[Any]:
        numbers = np.empty((part.stop - part.start, *first.shape), first.dtype)
        for at, file in enumerate(files[part]):
            picture = _decoded(file, kind)[0]
            if picture.shape != first.shape or picture.dtype != first.dtype:
                raise ValueError(
                    f"{file}: {picture.dtype} {picture.shape}, but {files[0].name} is "
                    f"{first.dtype} {first.shape}; give pictures of one recording"
                )
            numbers[at] = picture
        return numbers

    yield Stack(kind, len(files), first.nbytes, read, conditions=conditions)


def _decoded(path: Path, kind: Kind) -> tuple[NDArray[Any], Conditions]:
    if kind == "tiff":
        with opened_tiff(path) as stack:
            if stack.total != 1:
                raise ValueError(f"{path}: {stack.total} frames; give one stack, or a frame a file")
            return stack.read(slice(0, 1))[0], stack.conditions
    with opened_picture(path) as image:
        depth = int(file_bytes(path)[24])  # bits of a number, in the header
        mode, numbers = image.mode, np.array(image)
        text = "\n".join(f"{key}: {value}" for key, value in image.info.items())
    if (
        mode == "RGB" and depth == 8 and not np.ptp(numbers, axis=-1).any()
    ):  # gray, in three equal colors
        mode, numbers = "L", numbers[..., 0]
    if mode not in ("1", "L", "P", "I", "I;16"):
        raise DamagedFileError(f"{path}: in color; give gray pictures")
    if mode == "L" and depth < 8:  # which Pillow scales to 8
        numbers //= 255 // (2**depth - 1)
    return numbers.astype(np.uint16) if depth == 16 else numbers, conditions_in(text[:1000])
