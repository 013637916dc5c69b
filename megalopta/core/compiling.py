"""Compiling functions of arrays to machine code."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, overload

from numba import njit
from numba.core.caching import FunctionCache


@overload
def compiled(function: Callable[..., Any], /) -> Any: ...
@overload
def compiled(*, fastmath: set[str] = ..., inline: str = ...) -> Callable[..., Any]: ...
def compiled(function: Callable[..., Any] | None = None, /, **how: Any) -> Any:
    """Return the function compiled by numba when it is first called, and kept on disk.

    It runs beside other threads of Python, and divides as NumPy does: by 0 gives inf or NaN. With
    further options of `numba.njit` alone, return the decorator.
    """
    if function is None:
        return partial(compiled, **how)
    dispatcher = njit(**{"nogil": True, "error_model": "numpy", **how})(function)
    with suppress(RuntimeError):  # no place to keep it: it is compiled in every process
        dispatcher._cache = _KeptCode(function)
    return dispatcher


class _KeptCode(FunctionCache):  # type: ignore[misc]
    """Numba's cache; what cannot be read of it is compiled again.

    Its index holds the types of arguments, pickled: those of another version of the program may be
    of a class that is gone, and a file may be cut short.
    """

    def _load_overload(self, *key: Any) -> Any:
        try:
            return super()._load_overload(*key)
        except Exception:  # of a damaged pickle, anything
            self.flush()
            return None
