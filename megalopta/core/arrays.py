"""Types of arrays, arrays from files, spread, look-up. Every folder may import this module."""

import io
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import check_file

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def plain_array(content: bytes, kinds: str = "fiu") -> NDArray[Any] | None:
    """Return the numbers in the content of a .npy file; None if it holds less, more or others.

    `kinds` are the possible kinds of numbers (`numpy.dtype.kind`). Nothing is unpickled, and no
    memory is allocated for numbers that are only claimed.
    """
    file = io.BytesIO(content)
    try:
        header = _HEADERS[np.lib.format.read_magic(file)]
        shape, is_fortran, dtype = header(file)
        if dtype.kind not in kinds:
            return None
        values = np.frombuffer(content, dtype, offset=file.tell())
        return values.reshape(shape, order="F" if is_fortran else "C").copy("K")
    except Exception:  # a damaged header can raise any exception
        return None


def zipped_arrays(
    path: Path, names: Iterable[str] | None = None, kinds: str = "biuf"
) -> dict[str, NDArray[Any]]:
    """Return arrays of an uncompressed .npz file, all by default.

    Raises errors of any type if one is missing, or the file is anything else, for `undamaged`.
    """
    check_file(path)
    arrays = {}
    with zipfile.ZipFile(path) as file:
        members = {each.filename.removesuffix(".npy"): each for each in file.infolist()}
        for name in members if names is None else names:
            if members[name].compress_type != zipfile.ZIP_STORED:
                raise ValueError(f"{name} is compressed")
            values = plain_array(file.read(members[name]), kinds)  # verifies its checksum
            if values is None:
                raise ValueError(f"{name} is no complete array of plain numbers")
            arrays[name] = values
    return arrays


def robust_sigma(apart: Floats) -> float:
    """Return the standard deviation of normal differences from their center, by the median."""
    return 1.4826 * float(np.median(np.abs(apart)))


def mean_and_variance(frames: NDArray[Any]) -> tuple[Floats, Floats]:
    """Return the mean and variance (n − 1) over frames (n, …), without a copy of all of them."""
    mean = frames.mean(axis=0, dtype=np.float64)
    squares = np.zeros(mean.shape)
    for each in frames:
        squares += np.square(each - mean)
    return mean, squares / (len(frames) - 1)


def bilinear(picture: NDArray[Any], x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
    """Values (..., C) of a picture (H, W) or (H, W, C), which repeats, at columns and rows (...).

    0 is the center of the first pixel.
    """
    image = picture.reshape(*picture.shape[:2], -1)
    rows, columns = image.shape[:2]
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right, down = (x - left)[..., None], (y - top)[..., None]
    across = left % columns, (left + 1) % columns
    upper, lower = (
        (1 - right) * image[row, across[0]] + right * image[row, across[1]]
        for row in (top % rows, (top + 1) % rows)
    )
    return np.asarray((1 - down) * upper + down * lower)
