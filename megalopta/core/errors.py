"""Errors of users and of the machine, reported in one sentence."""

import errno
import os
import shlex
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path

_REMEDIES = {
    errno.ENOSPC: "the disk is full; free some space and run the same command again",
    errno.EDQUOT: "your disk quota is full; free some space and run the same command again",
    errno.EFBIG: "the file exceeds the size limit; raise it (ulimit -f)",
    errno.EIO: "the disk failed; use another",
    errno.EROFS: "the disk is read-only; use another",
    errno.EACCES: "permission denied; change its permissions, or choose another",
    errno.EPERM: "permission denied; change its permissions, or choose another",
    errno.ENOENT: "no such file or folder; check the path",
    errno.EISDIR: "it is a folder where a file is needed; choose another",
    errno.ENOTDIR: "a file is in the way; give the path of a folder",
    errno.EEXIST: "a file is in the way; give another path",
    errno.ELOOP: "circular symbolic links; give the file itself",
    errno.ENAMETOOLONG: "the name is too long; give a shorter one",
    errno.EMFILE: "too many open files; raise the limit (ulimit -n)",
    errno.ENFILE: "too many open files on this machine; close some",
}
"""Messages and remedies for errors of the operating system."""

_EXTRAS = {
    **dict.fromkeys(("mitsuba", "drjit", "OpenEXR", "trimesh"), "render"),
    **dict.fromkeys(("dask", "distributed"), "cluster"),
    **dict.fromkeys(("serial", "cobs"), "camera"),
    "av": "video",
    "ptufile": "timetags",
    **dict.fromkeys(("DracoPy", "meshopt", "opengl_basisu"), "gltf"),
    "torch": "torch",
    "onnxruntime": "onnx",
    "rerun": "rerun",
}
"""Extra that installs a package."""


def shell_command(*words: object) -> str:
    """Return a command of this program as a shell reads it, whatever its paths hold."""
    return shlex.join(["megalopta", *map(str, words)])


def nearest(word: str, known: Collection[str], all_are: str = "use one of") -> str:
    """Return "did you mean 'x'?" for a misspelled word; if none is near, what is known."""
    near = get_close_matches(word, known, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else f"{all_are} {', '.join(known)}"


def near_path(path: Path, remedy: str = "check the path") -> str:
    """Return "did you mean 'x'?" if a folder lacks a path, but has a near name; else a remedy."""
    names = [entry.name for entry in path.parent.glob("*")]
    near = [] if path.name in names else get_close_matches(path.name, names, n=1)
    return f"did you mean {str(path.with_name(near[0]))!r}?" if near else remedy


class UserError(Exception):
    """A user's error; the message names the cause and the remedy."""


def check_path(path: Path) -> None:
    """Refuse, with UserError, a missing path, before libraries are loaded for it."""
    if not os.path.lexists(path):
        raise UserError(f"{path}: no such file or folder; {near_path(path)}")


class DamagedFileError(UserError, ValueError):
    """A file is damaged or of the wrong kind; the message names it and the remedy.

    `reason` is the message without the remedy, if that may be replaced.
    """

    def __init__(self, message: str, reason: str = "") -> None:
        super().__init__(message)
        self.reason = reason


class TooLargeError(DamagedFileError):
    """A file states more than is read; the message names it, what it states, and the limit."""


@contextmanager
def refused_as(what: str = "", *kinds: type[Exception]) -> Iterator[None]:
    """Raise a ValueError of the work inside, or another of these kinds, as UserError.

    Its message is "what: problem", or the problem alone.
    """
    refused: tuple[type[Exception], ...] = ValueError, *kinds
    try:
        yield
    except refused as problem:
        raise UserError(f"{what}: {problem}" if what else str(problem)) from problem


def machine_problem(error: OSError) -> str | None:
    """Return an error of the operating system as "path: reason; remedy"; None for a bug of ours."""
    if error.errno is None and isinstance(error, FileNotFoundError | FileExistsError):
        return str(error)  # a sentence of a reader
    remedy = _REMEDIES.get(error.errno or 0)
    if remedy is None or error.filename is None:
        return remedy
    return f"{os.fsdecode(error.filename)}: {remedy}"


def missing_extra(error: ModuleNotFoundError) -> str | None:
    """Return which extra to install, in a sentence; None if no extra has the module."""
    package = (error.name or "").partition(".")[0]
    if package not in _EXTRAS:
        return None
    return f"{package} is not installed; pip install 'megalopta[{_EXTRAS[package]}]'"
