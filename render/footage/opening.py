"""Files and folders of pictures as footage, by suffix."""

from collections.abc import Callable, Mapping
from pathlib import Path

from megalopta.core.bounded import check_file
from megalopta.core.errors import UserError, machine_problem
from megalopta.render.footage.animation import is_animated, open_animation
from megalopta.render.footage.arrays import open_array
from megalopta.render.footage.film_reader import DEMUXERS
from megalopta.render.footage.frames import Footage, Unit
from megalopta.render.footage.pictures import KINDS, kind_of, open_folder, open_picture
from megalopta.render.footage.video import open_video

_ANIMATED = (".gif", ".png", ".webp")


def open_footage(path: Path, unit: Unit | None = None) -> Footage:
    """Return a picture, a folder of pictures, a video, an animation or an array as frames of light.

    `unit` is the unit of the values: required for arrays, and for 16-bit or floating-point pictures
    in an unusual unit. Close the returned footage.

    Raises UserError, in one sentence, for what cannot be read.
    """
    try:
        return _opened(path, unit)
    except OSError as problem:
        unreadable = f"{path}: cannot be read ({problem.strerror}); repair it"
        raise UserError(machine_problem(problem) or unreadable) from None


def is_footage(path: Path) -> bool:
    """True for a file with one of `SUFFIXES`, or a folder with a picture."""
    if path.is_dir():
        return any(kind_of(each) and each.is_file() for each in path.iterdir())
    return path.suffix.lower() in SUFFIXES


def _opened(path: Path, unit: Unit | None) -> Footage:
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


def _coded_only(path: Path, unit: Unit | None, opener: Callable[[Path], Footage]) -> Footage:
    if unit not in (None, "srgb"):
        raise UserError(f"{path} states how its codes become light; omit the unit {unit}")
    return opener(path)


def _open_video(path: Path, unit: Unit | None) -> Footage:
    return _coded_only(path, unit, open_video)


_OPENERS: Mapping[str, Callable[[Path, Unit | None], Footage]] = {
    **dict.fromkeys(KINDS, open_picture),
    **dict.fromkeys(DEMUXERS, _open_video),
    **dict.fromkeys((".npy", ".npz"), open_array),
}

SUFFIXES = tuple(_OPENERS)
"""Suffixes of supported files."""
