"""Every figure by its name: the modules of the folders here are looked through for recipes."""

import re
from collections.abc import Iterator
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from megalopta.errors import UserError
from megalopta.figures.recipe import FigureRecipe

_ROOT = Path(__file__).parent
_FOLDERS = [module.name for module in iter_modules([str(_ROOT)]) if module.ispkg]
GROUPS: dict[str, tuple[str, ...]] = {
    folder.replace("chapter", "chapter-"): (folder,) for folder in _FOLDERS
}
"""Names that stand for all figures in some folders"""
GROUPS["all"] = tuple(_FOLDERS)


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
    likely = sorted(_FOLDERS, key=lambda folder: f"-{folder[-1]}." not in name)
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


def _recipes(*folders: str) -> Iterator[FigureRecipe]:
    for folder in folders:
        for module in iter_modules([str(_ROOT / folder)]):
            found = import_module(f"megalopta.figures.{folder}.{module.name}")
            yield from getattr(found, "RECIPES", ())


def _place(recipe: FigureRecipe) -> list[str | int]:
    """Sort fig-4.9 before fig-4.10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", recipe.name)]
