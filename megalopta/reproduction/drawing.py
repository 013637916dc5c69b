"""Reproduce figures and tables of the dissertation with the models of this package.

Each becomes a picture to look at (PNG), one to print (SVG) and its numbers (CSV, and JSON with
parameters and intervals). The bytes depend only on the versions of this package, of NumPy and of
matplotlib; those of table-4.times and leaderboard also on the machine.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TypeAlias

from megalopta.benchmark.runner import Results, run
from megalopta.benchmark.trial import Sweep, Template, Trial, template_pixels
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.core.folders import ensure_directory
from megalopta.core.progress import progress, step
from megalopta.plotting.picture import Figure, write_figure
from megalopta.reproduction.sweep_figure import sweep_figure

_MODULES = [module.name for module in iter_modules([str(Path(__file__).parent)])]
_PREFIXES = "chapter2", "chapter3", "chapter4", "comparison"
GROUPS: dict[str, tuple[str, ...]] = {
    prefix.replace("chapter", "chapter-"): (prefix,) for prefix in _PREFIXES
}
"""Names of groups: all figures of some modules"""
GROUPS["all"] = _PREFIXES

Templates: TypeAlias = Mapping[Template, Floats]


@dataclass(frozen=True)
class Run:
    """Common data of all requested figures."""

    is_quick: bool = False
    results: Results = field(default_factory=dict)
    """Results of all trials"""

    templates: Templates = field(default_factory=dict)
    """Pixels of the trials' templates"""

    cache: Path | None = None
    """Folder of rendered panoramas; default: the user's"""


@dataclass(frozen=True)
class FigureRecipe:
    """A named figure, with its trials of the flow benchmark.

    Trials are known before they are run, so that figures share them.
    """

    name: str
    """Name, on the command line and in file names"""

    figure: Callable[[Run], Figure]
    trials: Callable[[bool], Sequence[Trial]] = lambda is_quick: ()
    """Maps quick form to the trials"""

    page: Callable[[Path, Sequence[Figure]], Path] | None = None
    """Writes a page into a folder, about all figures drawn there"""

    def make(self, run: Run) -> Figure:
        """Return the figure; one with fewer trials says so, in title and numbers."""
        made = replace(self.figure(run), name=self.name)
        if not (run.is_quick and self.trials(True)):
            return made
        title = f"{made.title} (quick form)"
        return replace(made, title=title, details={**made.details, "quick": True})


def find(name: str) -> list[FigureRecipe]:
    """Return the recipe of a name, or all of a group; imports only the modules needed.

    Raises UserError if there is none.
    """
    if name in GROUPS:
        return sorted(_recipes(*GROUPS[name]), key=_place)
    # fig-2.9 is most likely in chapter2
    likely = sorted(_PREFIXES, key=lambda prefix: f"-{prefix[-1]}." not in name)
    for recipe in _recipes(*likely):
        if recipe.name == name:
            return [recipe]
    known = (*GROUPS, *names())
    near = get_close_matches(name, known, n=3, cutoff=0.4)
    hint = f"did you mean {' or '.join(near)}?" if near else f"the figures are {', '.join(known)}"
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


@dataclass(frozen=True)
class Means:
    """Resources for trials of the flow benchmark; they change no number."""

    workers: int | None = None
    """Threads; default: one per core."""
    cache: Path | None = None
    """Folder of rendered panoramas; default: the user's"""
    scheduler: str | None = None
    """Address of a Dask cluster to use instead of threads."""


_THREADS = Means()


def reproduce(
    figures: Sequence[str], out: Path, is_quick: bool = False, means: Means = _THREADS
) -> list[Path]:
    """Write NAME.png, NAME.svg, NAME.csv and NAME.json of every named figure; return their paths.

    Names may be those of `GROUPS`. Results of the flow benchmark are kept in the folder `trials` of
    `out`, and not measured again. Quick forms of the figures of Chapter 4 go to its folder `quick`:
    complete ones are kept. Table 4.1 comes with a page, chapter-4.html. Raises UserError if a name
    is unknown, none is given or the folder is a file; nothing is written then.
    """
    if not figures:
        raise UserError(f"reproduce: name at least one figure of {', '.join(names())}")
    recipes = {recipe.name: recipe for name in figures for recipe in find(name)}.values()
    drawn = ensure_directory(out / "quick" if is_quick else out)
    trials = [trial for recipe in recipes for trial in recipe.trials(is_quick)]
    measured = _measure(trials, out, is_quick, means)
    made, paths = list[Figure](), list[Path]()
    with progress("Drawing figures", len(recipes), "figure") as advance:
        for recipe in recipes:
            with step(recipe.name):
                made.append(recipe.make(measured))
                paths += write_figure(made[-1], drawn)
            advance()
    return paths + [recipe.page(drawn, made) for recipe in recipes if recipe.page]


def reproduce_sweep(name: str, sweep: Sweep, out: Path, means: Means = _THREADS) -> list[Path]:
    """Measure a sweep and write its figure under this name; otherwise as `reproduce`."""
    ensure_directory(out)
    measured = _measure(sweep.trials, out, False, means)
    return write_figure(sweep_figure(name, sweep, measured.results), out)


def _measure(trials: Sequence[Trial], out: Path, is_quick: bool, means: Means) -> Run:
    templates = template_pixels((trial.template for trial in trials), means.cache)
    results = run(trials, templates, out / "trials", means.workers, means.scheduler)
    return Run(is_quick, results, templates, means.cache)
