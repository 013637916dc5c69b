"""Files that other files name: curves, maps, meshes, textures, panoramas, sensors, species.

One rule: a file may name what lies in its own folder, by a relative path, and nothing else, as it
may come from a stranger. Whatever a user names, on the command line or in Python, is read.
Every folder may import this module.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pydantic import ValidationInfo

from megalopta.core.bounded import ARRAY_BYTES, check_decoded, quoted, read_bytes
from megalopta.core.errors import DamagedFileError


def named_path(named: str | Path, folder: Path | None) -> Path:
    """Return the path of a file that a file in `folder` names; None: that the user names.

    Raises ValueError if it is not in that folder, after links are followed.
    """
    if folder is None:
        return Path(named)
    place = folder / named
    try:
        is_inside = place.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # circular links, a null byte
        is_inside = False
    if not is_inside or Path(named).is_absolute() or ":" in str(named):
        raise ValueError(
            f"{quoted(str(named))} is not in the folder of the file that names it; put it there "
            "and give its name, or name it on the command line"
        )
    return place


def folder_of(validation: ValidationInfo) -> Path | None:
    """Return the folder of the file whose values are validated; None if the user gave them."""
    return (validation.context or {}).get("folder")


@contextmanager
def unreadable(path: str | Path) -> Iterator[None]:
    """Raise an OSError of the work inside as ValueError, a sentence with the remedy."""
    try:
        yield
    except OSError as problem:
        reason = (problem.strerror or str(problem)).lower()
        raise ValueError(f"{path} cannot be read ({reason}); give a file's path") from None


def file_content(path: str | Path, field: str) -> bytes:
    """Return the content of a file.

    Raises ValueError if it cannot be read; names the field that refers to it.
    """
    try:
        with unreadable(path):
            check_decoded(path, (Path(path).stat().st_size,), 2)
            return read_bytes(path, ARRAY_BYTES)
    except DamagedFileError as problem:
        raise ValueError(f"{field}: {problem}") from None
    except ValueError as problem:
        is_path = "\0" not in str(path)
        said = str(problem) if is_path else f"{str(path)!r} is not a path; give a file's path"
        raise ValueError(f"{field}: {said}") from None
