"""Mitsuba and Dr.Jit, loaded with the chosen libLLVM: all code in `render` imports them from here.

Dr.Jit's own warning of a missing libLLVM is silenced; the choice of variant reports the same.
"""

import os
import sys
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

from megalopta.render.variant import Variant, llvm_in_use

llvm_in_use()
sys.stderr.flush()
kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
try:
    os.dup2(nowhere, 2)
    import drjit as dr
finally:
    os.dup2(kept, 2)
    os.close(kept)
    os.close(nowhere)

import mitsuba as mi  # noqa: E402

# Warnings, such as that samplers round up, are in the settings' help; errors are raised anyway.
mi.set_log_level(mi.LogLevel.Error)

__all__ = ["PlugIn", "activate", "dr", "is_scalar", "mi", "plug_in", "registered"]


def activate(variant: Variant) -> None:
    """Make Mitsuba use the variant from here on."""
    if mi.variant() != variant.name:
        mi.set_variant(variant.name)


def is_scalar() -> bool:
    """True if the active variant takes one ray at a time."""
    return str(mi.variant()).startswith("scalar")


class PlugIn:
    """Plug-in that adds to a Mitsuba class, in any variant.

    A class of the active variant has only that base: definitions of the plug-in are copied into it.
    """

    base: ClassVar[str]
    """Name of the Mitsuba class, such as "BSDF"."""
    above: ClassVar[Any]
    """Class of that name, in the active variant."""

    if TYPE_CHECKING:

        def __init__(self, properties: Any) -> None: ...

        def __getattr__(self, name: str) -> Any: ...


def plug_in(kind: Any) -> Any:
    """Return the class of a `PlugIn` in the active variant."""
    return _of_variant(kind, str(mi.variant()))[0]


def registered(kind: Any) -> str:
    """Return the name by which Mitsuba loads a `PlugIn` in the active variant."""
    return _of_variant(kind, str(mi.variant()))[1]


@cache
def _of_variant(kind: Any, variant: str) -> tuple[Any, str]:
    members = {name: value for cls in kind.__mro__[-2::-1] for name, value in vars(cls).items()}
    above, name = getattr(mi, kind.base), f"megalopta_{kind.__name__.strip('_').lower()}"
    body = {
        name: value
        for name, value in members.items()
        if name not in ("__dict__", "__weakref__", "base")
    }
    made = type(kind.__name__, (above,), {**body, "above": above})
    getattr(mi, f"register_{kind.base.lower()}")(name, made)
    return made, name
