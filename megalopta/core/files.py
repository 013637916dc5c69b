"""Files and folders that appear whole or not at all. Every room may import this module.

What is written has a temporary name of its own until it is whole and on the disk. A process that
was killed leaves such names behind; `sweep` removes them, once nobody else writes there.
"""

import errno
import json
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

_TEMPORARY = re.compile(r"\.part-[0-9a-f]{12}-")
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, for a file or a folder, that takes its place when whole.

    A file is replaced; a folder of this name must not be there. Raises OSError when it cannot be
    written; names `path`.
    """
    # The suffix stays last: image writers choose their format by it.
    temporary = path.with_name(f".part-{uuid4().hex[:12]}-{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        _sync(temporary)
        temporary.replace(path)
        _sync_names(path.parent)
    except OSError as problem:
        if problem.errno in _NO_ROOM or problem.filename in (None, str(temporary)):
            raise OSError(problem.errno, problem.strerror or str(problem), str(path)) from problem
        raise
    finally:
        remove(temporary)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    """Write JSON whole or not at all."""
    write_text(path, json.dumps(value, indent=1, allow_nan=False) + "\n")


def remove(path: Path) -> None:
    """Remove a file, a link or a folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def sweep(folder: Path) -> None:
    """Remove from a folder and all below it what writers that were killed have left."""
    for path in [path for path in folder.rglob(".part-*") if is_temporary(path)]:
        remove(path)


def is_temporary(path: Path) -> bool:
    """Whether a path is, or lies in, something that is not whole yet."""
    return any(_TEMPORARY.match(part) for part in path.parts)


def _sync(path: Path) -> None:
    """Wait until a file, or a folder with all that is in it, is on the disk."""
    if path.is_dir():
        for child in path.iterdir():
            _sync(child)
    _sync_names(path)


def _sync_names(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
