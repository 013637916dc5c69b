"""Every figure by its name: modules that begin with a group's name are searched for recipes."""

import re
from collections.abc import Iterator
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from megalopta.core.errors import UserError
from megalopta.reproduction.recipe import FigureRecipe

_MODULES = [module.name for module in iter_modules([str(Path(__file__).parent)])]
_PREFIXES = "chapter2", "chapter3", "chapter4", "comparison"
GROUPS: dict[str, tuple[str, ...]] = {
    prefix.replace("chapter", "chapter-"): (prefix,) for prefix in _PREFIXES
}
"""Names that stand for all figures of some modules"""
GROUPS["all"] = _PREFIXES


def find(name: str) -> list[FigureRecipe]:
    """Return the recipe of this name, or all of a group; imports no more modules than it needs.

    Raises
    ------
    UserError
        When there is none.
    """
    if name in GROUPS:
        return sorted(_recipes(*GROUPS[name]), key=_place)
    # fig-2.9 is in chapter2, most likely
    likely = sorted(_PREFIXES, key=lambda prefix: f"-{prefix[-1]}." not in name)
    for recipe in _recipes(*likely):
        if recipe.name == name:
            return [recipe]
    known = (*GROUPS, *names())
    near = get_close_matches(name, known, n=3, cutoff=0.4)
    hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(known)}"
    raise UserError(f"reproduce: no figure {name!r}; {hint}")


def names(group: str = "all") -> list[str]:
    """Return the names of all figures of a group."""
    return [recipe.name for recipe in find(group)]


def _recipes(*prefixes: str) -> Iterator[FigureRecipe]:
    for prefix in prefixes:
        for module in _MODULES:
            if module.startswith(f"{prefix}_"):
                found = import_module(f"megalopta.reproduction.{module}")
                yield from getattr(found, "RECIPES", ())


def _place(recipe: FigureRecipe) -> list[str | int]:
    """Sort fig-4.9 before fig-4.10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", recipe.name)]
