"""Compile array functions to machine code."""

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
    """Return the function, compiled by numba on its first call and cached on disk.

    It releases the GIL and divides as NumPy does: division by 0 gives inf or NaN. With only further
    options of `numba.njit`, return the decorator.
    """
    if function is None:
        return partial(compiled, **how)
    dispatcher = njit(**{"nogil": True, "error_model": "numpy", **how})(function)
    with suppress(RuntimeError):  # no writable cache: compiled in every process
        dispatcher._cache = _KeptCode(function)
    return dispatcher


class _KeptCode(FunctionCache):  # type: ignore[misc]
    """Numba's cache; entries that cannot be read are compiled again.

    Its index holds pickled argument types: another version of the program may lack a class, and a
    file may be truncated.
    """

    def _load_overload(self, *key: Any) -> Any:
        try:
            return super()._load_overload(*key)
        except Exception:  # a damaged pickle can raise any exception
            self.flush()
            return None
