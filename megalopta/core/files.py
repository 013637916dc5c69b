"""Files and folders written atomically.

Output has a temporary name until it is complete; those of killed processes are swept later.
"""

import csv
import errno
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

_TEMPORARY = re.compile(r"\.part-[0-9a-f]{12}-")
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def atomic_write(path: Path, lasting: bool = True) -> Iterator[Path]:
    """Yield a temporary path for a file or folder, which replaces `path` when complete.

    A file is replaced; a folder of this name must not exist. It survives a loss of power if it is
    `lasting`. Raises OSError, naming `path`, if it cannot be written.
    """
    # The suffix stays last: image writers choose the format by it.
    temporary = path.with_name(f".part-{uuid4().hex[:12]}-{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        if lasting:
            _sync(temporary)
        temporary.replace(path)
        if lasting:
            _sync(path.parent, deep=False)
    except OSError as problem:
        if problem.errno in _NO_ROOM or problem.filename in (None, str(temporary)):
            raise OSError(problem.errno, problem.strerror or str(problem), str(path)) from problem
        raise
    finally:
        with suppress(OSError):  # threads of an interrupted writer may still add; swept later
            remove(temporary)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    """Write JSON atomically."""
    write_text(path, json.dumps(value, indent=1, allow_nan=False) + "\n")


def write_csv(
    path: Path, head: Iterable[str], rows: Iterable[Iterable[Any]], digits: int = 6
) -> None:
    """Write a table as CSV atomically; numbers have this many digits."""
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(head)
        for row in rows:
            lines.writerow(
                f"{value:.{digits}g}" if isinstance(value, int | float) else value for value in row
            )


def remove(path: Path) -> None:
    """Remove a file, a link or a folder, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def sweep(folder: Path) -> None:
    """Remove temporary files of killed writers from a folder and all folders below it."""
    for path in [path for path in folder.rglob(".part-*") if is_temporary(path)]:
        remove(path)


def is_temporary(path: Path) -> bool:
    """True if a path is, or lies in, temporary output."""
    return any(_TEMPORARY.match(part) for part in path.parts)


def natural_key(path: Path) -> list[tuple[int, str]]:
    """Return a sort key by the numbers in names: frame 9 before frame 10."""
    parts = re.split("([0-9]+)", path.name)
    numbers = [(int(part), "") if k % 2 else (-1, part) for k, part in enumerate(parts)]
    return [*numbers, (-2, path.name)]


def files_in(paths: Iterable[Path]) -> Iterator[Path]:
    """Files among these paths and in folders among them, except temporary ones."""
    for path in paths:
        inside = path.rglob("*") if path.is_dir() else [path]
        yield from (file for file in inside if file.is_file() and not is_temporary(file))


def _sync(path: Path, deep: bool = True) -> None:
    """Wait until a file, or a folder with its names and content, is on the disk."""
    for child in path.iterdir() if deep and path.is_dir() else ():
        _sync(child)
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
