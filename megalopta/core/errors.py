"""A user's mistake, or the machine's limits, told in one sentence."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager

_REMEDIES = {
    errno.ENOSPC: "the disk is full; make room and run the same command again",
    errno.EDQUOT: "your share of the disk is full; make room and run the same command again",
    errno.EFBIG: "the file grows larger than allowed; raise the limit (ulimit -f)",
    errno.EIO: "the disk fails; use another",
    errno.EROFS: "the disk is read-only; use another",
    errno.EACCES: "not permitted; change its permissions, or choose another",
    errno.EPERM: "not permitted; change its permissions, or choose another",
    errno.ENOENT: "no such file or folder; check the path",
    errno.EISDIR: "it is a folder where a file is needed; choose another",
    errno.ENOTDIR: "a file is in the way; give the path of a folder",
    errno.EEXIST: "a file is in the way; give another path",
    errno.ELOOP: "symbolic links lead in a circle; give the file itself",
    errno.ENAMETOOLONG: "the name is too long; give a shorter one",
    errno.EMFILE: "too many open files; raise the limit (ulimit -n)",
    errno.ENFILE: "too many open files on this machine; close some",
}
"""What the machine refuses, and the way out."""

_EXTRAS = {
    **dict.fromkeys(("mitsuba", "drjit", "OpenEXR", "trimesh"), "render"),
    **dict.fromkeys(("dask", "distributed"), "cluster"),
    **dict.fromkeys(("serial", "cobs"), "camera"),
    "av": "video",
    "torch": "torch",
    "onnxruntime": "onnx",
    "rerun": "rerun",
}
"""Which extra installs a package."""


class UserError(Exception):
    """What the user asked for cannot be done; the message says what, and the way out."""


class DamagedFileError(UserError, ValueError):
    """A file is not what it should be; the message names it, and the way out."""


@contextmanager
def refused_as(what: str) -> Iterator[None]:
    """Tell the user a ValueError of the work inside, as "what: problem"."""
    try:
        yield
    except ValueError as problem:
        raise UserError(f"{what}: {problem}") from None


def machine_problem(error: OSError) -> str | None:
    """What the machine refused, as "path: reason; remedy"; None where the fault is ours."""
    remedy = _REMEDIES.get(error.errno or 0)
    if remedy is None or error.filename is None:
        return remedy
    return f"{os.fsdecode(error.filename)}: {remedy}"


def missing_extra(error: ModuleNotFoundError) -> str | None:
    """Return which extra is to be installed, in a sentence; None where no extra has the module."""
    package = (error.name or "").partition(".")[0]
    if package not in _EXTRAS:
        return None
    return f"{package} is not installed; pip install 'megalopta[{_EXTRAS[package]}]'"
