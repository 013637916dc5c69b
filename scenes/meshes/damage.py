"""Errors of files of strangers: whatever goes wrong inside is one sentence."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from megalopta.core.bounded import quoted
from megalopta.core.errors import DamagedFileError


@contextmanager
def refused_as_damaged(path: str) -> Iterator[None]:
    """Raise any error of the reading inside as DamagedFileError, with the path of the file."""
    try:
        with np.errstate(all="ignore"):  # of numbers that are then refused
            yield
    except DamagedFileError as problem:
        raise DamagedFileError(f"{path}: {problem}") from None
    except Exception as problem:  # a damaged file can raise any exception
        message = str(problem) if type(problem) is ValueError else type(problem).__name__
        raise DamagedFileError(
            f"{path} cannot be read ({quoted(message)}); repair it, or export it again"
        ) from None
