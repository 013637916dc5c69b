"""Recipes of figures: modules that begin with a group's name list theirs in RECIPES."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TypeAlias

from megalopta.benchmark.runner import Results
from megalopta.benchmark.templates import Template
from megalopta.benchmark.trial import Trial
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.plotting.picture import Figure

_MODULES = [module.name for module in iter_modules([str(Path(__file__).parent)])]
_PREFIXES = "chapter2", "chapter3", "chapter4", "comparison"
GROUPS: dict[str, tuple[str, ...]] = {
    prefix.replace("chapter", "chapter-"): (prefix,) for prefix in _PREFIXES
}
"""Names that stand for all figures of some modules"""
GROUPS["all"] = _PREFIXES

Templates: TypeAlias = Mapping[Template, Floats]


@dataclass(frozen=True)
class Run:
    """Data that figures are made from, the same for all that are asked for at once."""

    is_quick: bool = False
    results: Results = field(default_factory=dict)
    """Of the trials of all of them"""

    templates: Templates = field(default_factory=dict)
    """The pixels of the trials' templates"""

    cache: Path | None = None
    """Folder of rendered panoramas; by default the user's"""


@dataclass(frozen=True)
class FigureRecipe:
    """A figure under its name, with the trials of the flow benchmark that it rests on.

    These are known before they are run, so that figures share them.
    """

    name: str
    """As on the command line and in file names"""

    figure: Callable[[Run], Figure]
    trials: Callable[[bool], Sequence[Trial]] = lambda is_quick: ()
    """Whether in quick form, to the trials"""

    page: Callable[[Path, Sequence[Figure]], Path] | None = None
    """Writes a page into a folder, about all figures drawn there"""

    def make(self, run: Run) -> Figure:
        """Return the figure; one that rests on fewer trials says so, in title and numbers."""
        made = replace(self.figure(run), name=self.name)
        if not (run.is_quick and self.trials(True)):
            return made
        title = f"{made.title} (quick form)"
        return replace(made, title=title, details={**made.details, "quick": True})


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
