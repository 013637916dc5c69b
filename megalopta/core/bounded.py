"""Read files within bounds. Every folder may import this module.

A file may name a device, a pipe or something endless: only regular files are read, up to a limit.
"""

import json
import math
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from megalopta.core.errors import DamagedFileError, TooLargeError, UserError

TEXT_BYTES = 64 * 1024**2
"""Largest text file that is read, such as YAML, JSON or CSV."""
ARRAY_BYTES = 4 * 1024**3
"""Largest array or picture that is read."""
DECODED_GB = 2.0
"""Memory that the content of a file may take, unless MEGALOPTA_DECODED_GB says more."""
_VALUE_BYTES = 100
"""Memory of a value of JSON."""
QUOTED = 200
"""Most characters of a value in a message."""
SENTENCE = 800
"""Most characters of a message."""


def read_bytes(path: str | Path, at_most: int = TEXT_BYTES) -> bytes:
    """Return the content of a regular file.

    Raises DamagedFileError if it is no regular file or larger than `at_most` bytes, or than the
    budget of memory. Raises OSError if it cannot be read.
    """
    check_file(path, at_most)  # before opening, which some devices act on
    # Opening a pipe without a writer would block.
    descriptor = os.open(
        path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    )
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(file.fileno())
        _check(path, status, at_most)
        check_decoded(path, (status.st_size,), 1)
        content = file.read(status.st_size + 1)  # Python allocates as many bytes
    if len(content) > at_most:
        raise DamagedFileError(_too_large(path, at_most))
    return content


def read_text(path: str | Path, at_most: int = TEXT_BYTES) -> str:
    """Return the text of a regular file; errors as `read_bytes`, ValueError if not UTF-8."""
    return read_bytes(path, at_most).decode("utf-8")


def read_json(path: str | Path, at_most: int = TEXT_BYTES) -> Any:
    """Return the content of a JSON file; errors as `read_text`, ValueError if it is not JSON."""
    return from_json(read_text(path, at_most))


def from_json(text: str) -> Any:
    """Parse JSON text. Raises ValueError, also if it is nested too deeply or too large."""
    check_decoded("its JSON", (text.count(",") + 1,), _VALUE_BYTES)
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def check_file(path: str | Path, at_most: int = ARRAY_BYTES) -> None:
    """Refuse, before a library opens it, an irregular or too large file; errors as above."""
    _check(path, Path(path).stat(), at_most)


def budget_bytes() -> float:
    """Return the memory that the content of a file may take. Raises UserError."""
    given = os.environ.get("MEGALOPTA_DECODED_GB", str(DECODED_GB))
    try:
        return float(given) * 1e9
    except ValueError:
        raise UserError(
            f"MEGALOPTA_DECODED_GB: {quoted(given)!r}; give a number of gigabytes, such as 4"
        ) from None


def check_decoded(path: object, shape: Iterable[int], bytes_each: float) -> None:
    """Refuse, before a reader decodes it, what takes more memory than the budget.

    `shape` is the shape that the file states, of what is in memory at once; `bytes_each` are the
    bytes of a value there, copies of the reader included. A few bytes on disk can state any shape.
    Raises TooLargeError, or UserError if the setting is no number.
    """
    budget_gb = budget_bytes() / 1e9
    sizes = [min(max(size, -1), 10**18) for size in shape]  # a file can state thousands of digits
    decoded_gb = math.prod(sizes) * bytes_each / 1e9
    if not decoded_gb <= budget_gb or min(sizes, default=0) < 0:
        raise TooLargeError(
            f"{path} takes {abs(decoded_gb):.3g} GB of memory ({' × '.join(map(str, sizes))} "
            f"values), more than {budget_gb:g} GB; shrink it, or set MEGALOPTA_DECODED_GB"
        )


def check_count(path: object, things: str, count: int, at_most: int) -> None:
    """Refuse a file that holds more things, such as nodes, than any reader is meant for.

    Raises TooLargeError.
    """
    if not 0 <= count <= at_most:
        stated = min(count, 10**18)
        raise TooLargeError(f"{path} holds {stated:,} {things}; at most {at_most:,} are read")


@contextmanager
def undamaged(path: object, remedy: str | None = None) -> Iterator[None]:
    """Raise any error of the reading inside as DamagedFileError, with path and remedy.

    An error that begins with the path keeps its words, but for the remedy; damage of a part is
    named after the path. Other errors for users, missing packages and lack of memory pass, and so
    do errors about size.
    """
    try:
        yield
    except TooLargeError:
        raise
    except Exception as problem:  # a damaged file can raise any exception
        said = " ".join(str(problem).split())
        if isinstance(problem, DamagedFileError) and str(path) not in said:
            raise DamagedFileError(f"{path}: {said}") from problem
        if said.startswith(str(path)) and isinstance(problem, ValueError | OSError):
            what = said.rpartition("; ")[0] or said
            raise DamagedFileError(f"{what}; {remedy}" if remedy else said) from problem
        if isinstance(problem, UserError | ImportError | MemoryError):
            raise
        raise DamagedFileError(
            f"{path} is missing or damaged ({_reason(problem)}); {remedy or 'copy it again'}"
        ) from problem


def _reason(problem: Exception) -> str:
    """Return why a file cannot be read, in one line."""
    from pydantic_core import ValidationError

    if isinstance(problem, ValidationError):  # its own text has several lines, of every error
        first = problem.errors(include_url=False, include_input=False)[0]
        return quoted(": ".join([".".join(map(str, first["loc"])), first["msg"]]).strip(": "))
    lacking = "lacks " * isinstance(problem, KeyError)
    said = " ".join(str(problem).split())
    told = getattr(problem, "strerror", None) or lacking + quoted(said)
    return told or type(problem).__name__


def quoted(value: object, at_most: int = QUOTED) -> str:
    """Return a value for a message, shortened if it is long."""
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= at_most else f"{text[:at_most]}…"


def printable(text: str) -> str:
    """Return untrusted text for a terminal, a file or a page: one line, no control codes."""
    return "".join(
        each if each.isprintable() else each.encode("unicode_escape").decode("ascii")
        for each in text
    )


def cut(message: str, given: Any) -> str:
    """Return a message that quotes at most `QUOTED` characters of any text in `given`."""
    if len(message) > QUOTED:
        for text in _texts(given):
            message = message.replace(text, quoted(text)) if len(text) > QUOTED else message
    return message


def _texts(values: Any) -> Iterator[str]:
    if isinstance(values, str):
        yield values
    elif isinstance(values, Mapping):
        yield from _texts(list(values.items()))
    elif isinstance(values, list | tuple):
        for value in values:
            yield from _texts(value)


def sentence(text: str, at_most: int = SENTENCE) -> str:
    """Return a message as one line with control characters escaped.

    The middle of a long message is cut: its field is at the beginning, its remedy at the end.
    """
    line = printable(" ".join(text.split()))
    half = at_most // 2
    return line if len(line) <= at_most else f"{line[:half]} … {line[-half:]}"


def _check(path: str | Path, status: os.stat_result, at_most: int) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(21, "Is a directory", str(path))
    if not stat.S_ISREG(status.st_mode):
        raise DamagedFileError(f"{path}: not a regular file; give a file, not a device or pipe")
    if status.st_size > at_most:
        raise DamagedFileError(_too_large(path, at_most))


def _too_large(path: str | Path, at_most: int) -> str:
    return f"{path}: larger than {at_most / 1e6:.0f} MB, the limit for such a file"
