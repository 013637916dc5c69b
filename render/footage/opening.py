"""Files and folders of pictures, films and arrays as footage, by suffix."""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import check_file, mapped_array
from megalopta.core.errors import DamagedFileError, UserError, machine_problem
from megalopta.render.footage.film import DEMUXERS, Film
from megalopta.render.footage.frames import (
    Coding,
    Footage,
    Unit,
    check_size,
    coding_of,
    light_of,
)
from megalopta.render.footage.pictures import KINDS, open_folder, open_picture, picture_kind

SUFFIXES = (*KINDS, *DEMUXERS, ".npy")
"""Suffixes of supported files."""
_NAMES: Mapping[Unit, str] = {"srgb": "sRGB", "linear": "linear", "cd/m2": "cd/m²"}


class ArrayFrames(Footage):
    """Frames of an array (H, W), (T, H, W), (H, W, 3) or (T, H, W, 3).

    `path` names it in messages. Raises UserError.
    """

    def __init__(self, values: NDArray[Any], unit: Unit, path: Path) -> None:
        frames = values
        if values.ndim == 2 or (values.ndim == 3 and values.shape[-1] == 3):
            frames = values[None]
        is_gray = frames.ndim == 3 and frames.shape[-1] not in (1, 2, 4)
        if not frames.size or not (is_gray or (frames.ndim == 4 and frames.shape[-1] == 3)):
            raise DamagedFileError(
                f"{path} has the shape {frames.shape}; give (H, W), (T, H, W), (H, W, 3) or "
                "(T, H, W, 3), without an alpha channel"
            )
        check_size(path, frames.shape[1:])
        dtype, coding = values.dtype, Coding(_NAMES[unit], unit)
        if dtype.kind != "f":
            if dtype.kind != "u" or dtype.itemsize > 2:
                raise DamagedFileError(
                    f"{path} holds {dtype}; give uint8, uint16 or floating-point numbers"
                )
            codes = 256**dtype.itemsize
            coding = coding_of("sRGB" if unit == "srgb" else "linear", codes)
            if unit == "cd/m2":
                coding = replace(coding, table=np.arange(codes, dtype=np.float32))
            coding = replace(coding, name=_NAMES[unit], unit=unit)
        super().__init__(
            path=path, files=(path,), count=len(frames), shape=frames.shape[1:3], coding=coding
        )
        self._values = frames

    def _numbers(self, index: int) -> NDArray[Any]:
        numbers = np.asarray(self._values[index])
        if self.coding.table is not None:
            return numbers.astype(numbers.dtype.newbyteorder("="))
        if self.unit != "srgb":
            return self._as_light(numbers, self.path)
        if not ((numbers >= 0) & (numbers <= 1)).all():
            raise DamagedFileError(
                f"{self.path} has values that are not between 0 and 1; scale them, or give the "
                "unit linear"
            )
        return self._as_light(light_of("sRGB", numbers.astype(np.float64)), self.path)


def open_array(path: Path, unit: Unit | None) -> ArrayFrames:
    """Return the array of a file as frames. Raises UserError."""
    if unit is None:
        raise UserError(
            f"{path}: an array does not state its unit; give the unit srgb (coded as in "
            "pictures), linear (proportional to light) or cd/m2 (luminance)"
        )
    check_file(path, sys.maxsize)  # read frame by frame
    try:
        values = mapped_array(path)
    except Exception:  # a damaged header can raise anything
        raise DamagedFileError(
            f"{path} is not a complete array of numbers; write it with numpy.save"
        ) from None
    return ArrayFrames(values, unit, path)


def open_footage(path: Path, unit: Unit | None = None) -> Footage:
    """Return a picture, a folder of pictures, a video, an animation or an array as frames of light.

    `unit` is the unit of the values: required for arrays, and for 16-bit or floating-point pictures
    in an unusual unit. Close the returned footage.

    Raises UserError, in one sentence, for what cannot be read.
    """
    try:
        if path.is_dir():
            return open_folder(path, unit)
        check_file(path, at_most=2**63 - 1)  # each reader has its own limit
        suffix = path.suffix.lower()
        if suffix not in SUFFIXES:
            raise UserError(
                f"{path}: {suffix or 'no suffix'}, not a supported picture, video or array; give a "
                f"folder of pictures, or one of {', '.join(SUFFIXES)}"
            )
        if not path.stat().st_size:
            raise UserError(f"{path} is empty; copy it again")
        if suffix == ".npy":
            return open_array(path, unit)
        if suffix in KINDS:
            return open_picture(path, unit)
        if unit not in (None, "srgb"):
            raise UserError(f"{path} states how its codes become light; omit the unit {unit}")
        return Film(path)
    except OSError as problem:
        unreadable = f"{path}: cannot be read ({problem.strerror}); repair it"
        raise UserError(machine_problem(problem) or unreadable) from None


def is_footage(path: Path) -> bool:
    """True for a file with one of `SUFFIXES`, or a folder with a picture."""
    if path.is_dir():
        return any(picture_kind(file) and file.is_file() for file in path.iterdir())
    return path.suffix.lower() in SUFFIXES
