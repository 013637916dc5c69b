"""Mitsuba and Dr.Jit, loaded with the libLLVM that was chosen, without a complaint if none is.

Dr.Jit writes a line of its own on import, past Python; the choice of variant says the same, with
the remedy. So everything here gets the two as `dr` and `mi` from this module.

A class of Mitsuba's exists once in each variant. What is added to it is written as a plain class,
of which `registered` makes one of the active variant.
"""

import os
import sys
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

from megalopta.render.variant import Variant, llvm_in_use


def _load_silently() -> None:
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        import drjit  # noqa: F401
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


llvm_in_use()
if "drjit" not in sys.modules:
    _load_silently()

import drjit as dr  # noqa: E402
import mitsuba as mi  # noqa: E402

__all__ = ["PlugIn", "activate", "dr", "is_scalar", "mi", "plug_in", "registered"]


def activate(variant: Variant) -> None:
    """Make Mitsuba use the variant from here on."""
    if mi.variant() != variant.name:
        mi.set_variant(variant.name)


def is_scalar() -> bool:
    """Whether the active variant takes one ray at a time."""
    return str(mi.variant()).startswith("scalar")


class PlugIn:
    """What a plug-in of Mitsuba's adds to its class there, in any variant."""

    base: ClassVar[str]
    """Name of the class, such as "BSDF"."""

    if TYPE_CHECKING:

        def __init__(self, properties: Any) -> None: ...

        def __getattr__(self, name: str) -> Any: ...

        def traverse(self, callback: Any) -> None:
            """Tell Mitsuba of parameters."""

    def to_string(self) -> str:
        """Return the name of the class."""
        return f"{type(self).__name__}[]"


def plug_in(kind: type[PlugIn]) -> Any:
    """Return the class of the active variant."""
    return _of_variant(kind, str(mi.variant()))


@cache
def _of_variant(kind: type[PlugIn], variant: str) -> Any:
    return type(kind.__name__, (kind, getattr(mi, kind.base)), {})


def registered(kind: type[PlugIn]) -> str:
    """Return the name by which Mitsuba loads a plug-in in the active variant."""
    return _registered(kind, str(mi.variant()))


@cache
def _registered(kind: type[PlugIn], variant: str) -> str:
    name = f"megalopta_{kind.__name__.strip('_').lower()}"
    getattr(mi, f"register_{kind.base.lower()}")(name, plug_in(kind))
    return name
