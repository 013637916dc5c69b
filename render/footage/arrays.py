"""Arrays in `.npy` and `.npz` as footage."""

import sys
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import ARRAY_BYTES, check_file, plain_array
from megalopta.core.errors import DamagedFileError, UserError
from megalopta.render.footage.frames import Coding, Footage, Unit, check_size, coding_of
from megalopta.render.footage.transfer import light_of

_NAMES: Mapping[Unit, str] = {"srgb": "sRGB", "linear": "linear", "cd/m2": "cd/m²"}


@dataclass(eq=False, kw_only=True)
class ArrayFrames(Footage):
    """Frames of an array (T, H, W) or (T, H, W, 3)."""

    values: NDArray[Any]

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.values)

    def _numbers(self, index: int) -> NDArray[Any]:
        numbers = np.asarray(self.values[index])
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
    """Return an array (H, W), (T, H, W), (H, W, 3) or (T, H, W, 3) as frames. Raises UserError."""
    if unit is None:
        raise UserError(
            f"{path}: an array does not state its unit; give the unit srgb (coded as in "
            "pictures), linear (proportional to light) or cd/m2 (luminance)"
        )
    values = _zipped(path) if path.suffix.lower() == ".npz" else _mapped(path)
    return array_frames(values, unit, path)


def array_frames(values: NDArray[Any], unit: Unit, path: Path) -> ArrayFrames:
    """Return an array as frames; `path` names it in messages. Raises UserError."""
    frames = _frames(path, values)
    check_size(path, frames.shape[1:])
    return ArrayFrames(
        path=path,
        files=(path,),
        shape=(frames.shape[1], frames.shape[2]),
        coding=_coding(path, values.dtype, unit),
        values=frames,
    )


def _mapped(path: Path) -> NDArray[Any]:
    check_file(path, sys.maxsize)  # read frame by frame
    try:
        return np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))
    except Exception:  # a damaged header can raise anything
        raise DamagedFileError(
            f"{path} is not a complete array of numbers; write it with numpy.save"
        ) from None


def _zipped(path: Path) -> NDArray[Any]:
    check_file(path)
    try:
        with zipfile.ZipFile(path) as file:
            entries = file.infolist()
            if len(entries) != 1 or entries[0].file_size > ARRAY_BYTES:
                raise DamagedFileError(
                    f"{path} holds {len(entries)} arrays; give one, of at most "
                    f"{ARRAY_BYTES / 1e9:.0f} GB, or a .npy file"
                )
            values = plain_array(file.read(entries[0]))
    except DamagedFileError:
        raise
    except Exception:  # from a damaged archive, too
        values = None
    if values is None:
        raise DamagedFileError(f"{path} holds no complete array; write it with numpy.savez")
    return values


def _frames(path: Path, values: NDArray[Any]) -> NDArray[Any]:
    """Return a view (T, H, W) or (T, H, W, 3)."""
    if values.ndim == 2 or (values.ndim == 3 and values.shape[-1] == 3):
        values = values[None]
    is_gray = values.ndim == 3 and values.shape[-1] not in (1, 2, 4)
    if not values.size or not (is_gray or (values.ndim == 4 and values.shape[-1] == 3)):
        raise DamagedFileError(
            f"{path} has the shape {values.shape}; give (H, W), (T, H, W), (H, W, 3) or "
            "(T, H, W, 3), without an alpha channel"
        )
    return values


def _coding(path: Path, dtype: np.dtype[Any], unit: Unit) -> Coding:
    if dtype.kind == "f":
        return Coding(_NAMES[unit], unit)
    if dtype.kind != "u" or dtype.itemsize > 2:
        raise DamagedFileError(
            f"{path} holds {dtype}; give uint8, uint16 or floating-point numbers"
        )
    codes = 256**dtype.itemsize
    coding = coding_of("sRGB" if unit == "srgb" else "linear", codes)
    if unit == "cd/m2":
        coding = replace(coding, table=np.arange(codes, dtype=np.float32))
    return replace(coding, name=_NAMES[unit], unit=unit)
