"""Mitsuba and Dr.Jit, loaded with the libLLVM that was chosen, without a complaint if none is.

Dr.Jit writes a line of its own on import, past Python; the choice of variant says the same, with
the remedy. So everything here gets the two as `dr` and `mi` from this module.
"""

import os
import sys

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

__all__ = ["activate", "dr", "mi"]


def activate(variant: Variant) -> None:
    """Make Mitsuba use the variant from here on."""
    if mi.variant() != variant.name:
        mi.set_variant(variant.name)
