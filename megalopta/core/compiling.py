"""Compiling functions of arrays to machine code."""

from collections.abc import Callable
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any]) -> Any:
    """Return the function compiled by numba when it is first called, and kept on disk.

    It runs beside other threads of Python, and divides as NumPy does: by 0 gives inf or NaN.
    """
    return njit(cache=True, nogil=True, error_model="numpy")(function)
