"""Folders, made before anything is computed for them, and one process at a time in each."""

import os
import platform
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout
from platformdirs import user_cache_path

from megalopta.core.errors import UserError
from megalopta.core.progress import say

LOCK_NAME = ".lock"
_PATIENCE_S = 0.2
"""Time for which nobody minds waiting in silence."""


def cache_folder(chosen: Path | None = None) -> Path:
    """Where results live that are costly to make and may be thrown away.

    The folder chosen, else `megalopta` where this system keeps caches, on Linux ~/.cache.
    """
    return chosen or user_cache_path("megalopta", appauthor=False)


def ensure_directory(path: Path) -> Path:
    """Make a folder, unless it is there, before anything is computed for it.

    Raises UserError when there is a file of this name on the way, or the folder cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise UserError(f"{path}: a file is in the way; give the path of a folder") from None
    except OSError as problem:
        raise UserError(
            f"{path}: no folder can be made there ({problem.strerror}); give another"
        ) from None
    return path


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes out of a folder, which is made if it is not there.

    Who comes second is told who is inside, and waits. Raises UserError when the folder cannot be
    made or written to, or the lock's file is something else.
    """
    path = ensure_directory(folder) / LOCK_NAME
    _check_lock(path)
    lock = FileLock(path)
    try:
        lock.acquire(timeout=_PATIENCE_S)
    except Timeout:
        say(f"{folder}: waiting for {_holder(path)} to finish; Ctrl-C gives up")
        lock.acquire()
    except OSError as problem:
        raise UserError(
            f"{folder}: cannot be written to ({problem.strerror}); give another folder"
        ) from None
    try:
        path.write_text(_myself(), encoding="utf-8")
        yield
    finally:
        # Whoever waits for the removed file notices, and makes a new one.
        path.unlink(missing_ok=True)
        lock.release()


def _check_lock(path: Path) -> None:
    """Refuse to write into what is no file of this folder alone. Raises UserError."""
    try:
        found = path.lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
        raise UserError(f"{path}: not the file that keeps other processes out; remove it")


def _myself() -> str:
    command = " ".join(["megalopta", *sys.argv[1:]])
    since = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M")
    return f"process {os.getpid()} on {platform.node()}, there since {since} ({command})"


def _holder(path: Path) -> str:
    try:
        return path.read_text("utf-8", errors="replace")[:500] or "another process"
    except OSError:
        return "another process"
