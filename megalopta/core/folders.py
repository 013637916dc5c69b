"""Folders: made before anything is computed for them, one process at a time in each, enclosed.

Nothing in a folder from somebody else leads out of it. A dataset is walked once when it is opened,
before anything in it is read or written. What it holds are then files, folders, and links to what
is inside it, so that no path below its folder leads to another place. Who can change the folder
meanwhile could do harm without it.
"""

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

from megalopta.core.bounded import TEXT_BYTES
from megalopta.core.errors import UserError
from megalopta.core.progress import say

LOCK_NAME = ".lock"
_METADATA = "zarr.json"
"""What Zarr reads whole, however large it is."""
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


def check_enclosed(root: Path) -> None:
    """Refuse a folder in which anything leads out of it, or is neither a file nor a folder.

    It takes about a tenth of a second for 100,000 files; without a folder nothing is done. Raises
    UserError, with the first such thing, and the way out.
    """
    real = Path(os.path.realpath(root))
    for entry in _entries(root):
        if entry.is_symlink():
            target = os.path.realpath(entry.path)
            if not Path(target).is_relative_to(real):
                raise UserError(
                    f"{entry.path}: a link that leads out of {root}, to {target}; remove it, or "
                    "put a copy of what it leads to in its place"
                )
        elif not entry.is_dir(follow_symlinks=False):
            _check_file(entry)


def check_no_links(path: Path) -> None:
    """Refuse a path that is a link, or a folder that holds one. Raises UserError."""
    links = (each.path for each in _entries(path) if each.is_symlink())
    if link := str(path) if path.is_symlink() else next(links, None):
        raise UserError(f"{link}: a link in the place of a file; remove it")


def _entries(root: Path) -> Iterator[os.DirEntry[str]]:
    """Yield everything below a folder; no link is followed."""
    folders = [str(root)]
    while folders:
        try:
            with os.scandir(folders.pop()) as entries:
                for entry in entries:
                    yield entry
                    if entry.is_dir(follow_symlinks=False):
                        folders.append(entry.path)
        except (FileNotFoundError, NotADirectoryError):  # gone meanwhile, or never there
            continue


def _check_file(entry: os.DirEntry[str]) -> None:
    if not entry.is_file(follow_symlinks=False):
        raise UserError(f"{entry.path}: neither a file nor a folder; remove it")
    if entry.name == _METADATA and entry.stat(follow_symlinks=False).st_size > TEXT_BYTES:
        raise UserError(
            f"{entry.path}: larger than {TEXT_BYTES / 1e6:.0f} MB, which no metadata is; remove it"
        )
