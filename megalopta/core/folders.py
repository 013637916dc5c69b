"""Create, lock and check folders of datasets.

A dataset is walked once when it is opened, and refused if a link leads out of it.
"""

import os
import platform
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from functools import cache
from pathlib import Path

from filelock import FileLock, Timeout

from megalopta.core.bounded import METADATA, TEXT_BYTES
from megalopta.core.errors import UserError
from megalopta.core.progress import say

LOCK_NAME = ".lock"


def ensure_directory(path: Path) -> Path:
    """Create a folder, unless it exists, before anything is computed for it.

    Raises UserError if a file of this name is in the way, or the folder cannot be created.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise UserError(f"{path}: a file is in the way; give the path of a folder") from None
    except OSError as problem:
        raise UserError(
            f"{path}: cannot create this folder ({problem.strerror}); give another"
        ) from None
    return path


@contextmanager
def locked(folder: Path, name: str = LOCK_NAME) -> Iterator[None]:
    """Lock a folder, or a name in it, against other processes; create it if it does not exist.

    A second process reports who holds the lock, and waits. Raises UserError if the folder cannot be
    created or written to, or the lock's file is something else.
    """
    path = ensure_directory(folder) / name
    _check_lock(path)
    lock = FileLock(path)
    try:
        lock.acquire(timeout=0.2)  # seconds, in silence
    except Timeout:
        holder = ""
        with suppress(OSError):
            holder = path.read_text("utf-8", errors="replace")[:500]
        say(f"{folder}: waiting for {holder or 'another process'} to finish; Ctrl-C cancels")
        lock.acquire()
    except OSError as problem:
        raise UserError(
            f"{folder}: not writable ({problem.strerror}); give another folder"
        ) from None
    try:
        command = " ".join(["megalopta", *sys.argv[1:]])
        since = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M")
        holder = f"process {os.getpid()} on {platform.node()}, since {since} ({command})"
        path.write_text(holder, encoding="utf-8")
        yield
    finally:
        # A process that waits for the removed file notices, and creates a new one.
        path.unlink(missing_ok=True)
        lock.release()


def remove_stale_lock(path: Path) -> None:
    """Remove the lock of a process that was killed; one that is held stays."""
    _check_lock(path)
    with suppress(Timeout), FileLock(path).acquire(timeout=0):
        path.unlink()


def _check_lock(path: Path) -> None:
    """Refuse to write into a lock that is not a file of this folder alone. Raises UserError."""
    try:
        status = path.lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
        raise UserError(f"{path}: not a lock file; remove it")


def check_enclosed(root: Path) -> None:
    """Refuse a folder with links that lead out of it, or with anything but files and folders.

    It takes about a tenth of a second for 100,000 files; without a folder it does nothing. Raises
    UserError for the first offender, with the remedy.
    """
    real = Path(os.path.realpath(root))
    is_inside = cache(lambda folder: Path(os.path.realpath(folder)).is_relative_to(real))
    for entry in _entries(root):
        if entry.is_symlink():
            # thousands of links lead to plain files of the same few folders
            path = os.path.join(entry.path.removesuffix(entry.name), os.readlink(entry.path))  # noqa: PTH115, PTH118
            folder, name = os.path.split(path)
            if name not in ("", ".", "..") and not os.path.islink(path) and is_inside(folder):  # noqa: PTH114
                continue
            target = os.path.realpath(entry.path)
            if not Path(target).is_relative_to(real):
                raise UserError(
                    f"{entry.path}: a link that leads out of {root}, to {target}; remove it, or "
                    "replace it by a copy of its target"
                )
        elif entry.is_dir(follow_symlinks=False):
            continue
        elif not entry.is_file(follow_symlinks=False):
            raise UserError(f"{entry.path}: neither a file nor a folder; remove it")
        elif entry.name == METADATA and entry.stat(follow_symlinks=False).st_size > TEXT_BYTES:
            limit = f"{TEXT_BYTES / 1e6:.0f} MB"
            raise UserError(f"{entry.path}: metadata larger than {limit}; remove it")


def _entries(root: Path) -> Iterator[os.DirEntry[str]]:
    """Yield everything below a folder without following links."""
    folders = [str(root)]
    while folders:
        try:
            with os.scandir(folders.pop()) as entries:
                for entry in entries:
                    yield entry
                    if entry.is_dir(follow_symlinks=False):
                        folders.append(entry.path)
        except (FileNotFoundError, NotADirectoryError):  # removed meanwhile, or never there
            continue
