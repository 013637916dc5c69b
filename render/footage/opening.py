"""Files and folders of pictures, arrays and animations as footage, by suffix."""

import math
import sys
import zipfile
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from megalopta.core.bounded import ARRAY_BYTES, check_count, check_file, plain_array
from megalopta.core.errors import DamagedFileError, UserError, machine_problem
from megalopta.core.pictures import opened_picture, readable
from megalopta.core.progress import working
from megalopta.render.footage.film import DEMUXERS, open_film
from megalopta.render.footage.frames import (
    TRANSPARENT,
    Coding,
    Footage,
    Unit,
    check_size,
    coding_of,
)
from megalopta.render.footage.pictures import (
    KINDS,
    coding_stated,
    frames_in,
    open_folder,
    open_picture,
    over_black,
    picture_kind,
    pillow_header,
)
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


_ANIMATED = (".gif", ".png", ".webp")


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
        if suffix in _ANIMATED and is_animated(path):
            return _coded_only(path, unit, open_animation)
        return _OPENERS[suffix](path, unit)
    except OSError as problem:
        unreadable = f"{path}: cannot be read ({problem.strerror}); repair it"
        raise UserError(machine_problem(problem) or unreadable) from None


def is_footage(path: Path) -> bool:
    """True for a file with one of `SUFFIXES`, or a folder with a picture."""
    if path.is_dir():
        return any(picture_kind(each) and each.is_file() for each in path.iterdir())
    return path.suffix.lower() in SUFFIXES


def _coded_only(path: Path, unit: Unit | None, opener: Callable[[Path], Footage]) -> Footage:
    if unit not in (None, "srgb"):
        raise UserError(f"{path} states how its codes become light; omit the unit {unit}")
    return opener(path)


def _open_film(path: Path, unit: Unit | None) -> Footage:
    return _coded_only(path, unit, open_film)


_OPENERS: Mapping[str, Callable[[Path, Unit | None], Footage]] = {
    **dict.fromkeys(KINDS, open_picture),
    **dict.fromkeys(DEMUXERS, _open_film),
    **dict.fromkeys((".npy", ".npz"), open_array),
}

SUFFIXES = tuple(_OPENERS)
"""Suffixes of supported files."""


_MOST_FRAMES = 10_000
_SHORTEST_S = 0.1
"""Duration that browsers use for a frame with a duration of zero."""


def is_animated(path: Path) -> bool:
    """True if a picture has more than one frame. Raises DamagedFileError if it is not a picture."""
    with opened_picture(path) as image:
        return frames_in(image) > 1


@dataclass(eq=False, kw_only=True)
class Animation(Footage):
    """Frames of an animated picture, with times from the file."""

    image: Image.Image
    opened: ExitStack = field(repr=False)
    first: int = 0
    """In APNG, 1 if the default picture is not part of the animation."""

    def __len__(self) -> int:
        """Return the number of frames."""
        return frames_in(self.image) - self.first

    def close(self) -> None:
        """Close the file."""
        super().close()
        self.opened.close()

    def _numbers(self, index: int) -> NDArray[Any]:
        if self.first + index < self.image.tell():  # Pillow cannot always seek backwards in APNG
            self.opened.close()
            self.image = self.opened.enter_context(opened_picture(self.path))
        with readable(self.path):
            codes, is_transparent = _frame(self.image, self.first + index)
        if is_transparent:
            self._note(TRANSPARENT)
        return codes


def open_animation(path: Path) -> Animation:
    """Return an animated picture, after decoding all of it once. Raises DamagedFileError."""
    with ExitStack() as stack, working(f"frames of {path}"):
        image = stack.enter_context(opened_picture(path))
        check_size(path, image.size[::-1])
        check_count(path, "frames", frames_in(image), _MOST_FRAMES)
        check_count(path, "pixels in its frames", frames_in(image) * math.prod(image.size), 10**9)
        header = pillow_header(path)
        first = int(bool(image.info.get("default_image")))
        lasts_s, is_transparent = list[float](), False
        for index in range(first, frames_in(image)):
            _, is_frame_transparent = _frame(image, index)
            lasts_s.append(float(image.info.get("duration") or 0) / 1000)
            is_transparent |= is_frame_transparent
        told = [f"{path} holds a picture that is no part of its animation, and is not read"] * first
        if 0.0 in lasts_s:
            told.append(
                f"{path} has frames of no duration; they last {_SHORTEST_S:g} s, as in browsers"
            )
            lasts_s = [each or _SHORTEST_S for each in lasts_s]
        return Animation(
            path=path,
            files=(path,),
            shape=image.size[::-1],
            coding=coding_stated(path, None, header),
            times_s=np.cumsum([0.0, *lasts_s[:-1]]),
            last_s=lasts_s[-1],
            notes=(*header.notes, *(TRANSPARENT,) * is_transparent, *told),
            image=image,
            opened=stack.pop_all(),
            first=first,
        )


def _frame(image: Image.Image, index: int) -> tuple[NDArray[np.uint8], bool]:
    size = image.size
    image.seek(index)
    if image.size != size:
        raise ValueError("a frame reaches beyond the picture")
    image.load()  # for WebP, sets the duration
    return over_black(image)
