"""Figures and tables of the dissertation, drawn again from the models of this package.

Each becomes a picture to look at (PNG), one to print (SVG) and the numbers behind it (CSV, and JSON
with parameters and intervals). The bytes depend on the versions of this package, of NumPy and of
matplotlib only; those of table-4.times and leaderboard on the machine as well.
"""

import multiprocessing
import os
import re
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, TypeAlias, TypeVar

from megalopta.benchmark.runner import Results, run
from megalopta.benchmark.trial import Sweep, Template, Trial, pixels_of
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.core.folders import ensure_directory
from megalopta.core.progress import progress
from megalopta.plotting.picture import Figure, write_figure
from megalopta.reproduction.sweep_figure import sweep_figure

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

    Raises UserError when there is none.
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


Result = TypeVar("Result")

_tasks: Sequence[Callable[[], Any]] = ()
"""Those of the processes that are forked next."""


@dataclass(frozen=True)
class Means:
    """Means to measure trials of the flow benchmark with; they change no number."""

    workers: int | None = None
    """Threads that measure; by default one for each core."""
    cache: Path | None = None
    """Folder of rendered panoramas; by default the user's."""
    scheduler: str | None = None
    """Address of a Dask cluster that measures instead of threads."""


_THREADS = Means()


def reproduce(
    figures: Sequence[str], out: Path, is_quick: bool = False, means: Means = _THREADS
) -> list[Path]:
    """Write NAME.png, NAME.svg, NAME.csv and NAME.json of every figure named; return their paths.

    Names may be those of `GROUPS`. Results of the flow benchmark are kept in the folder `trials` of
    `out`, and are not measured again. Quick forms of the figures of Chapter 4 are drawn into its
    folder `quick`: whole ones stay as they are. With Table 4.1 comes a page, chapter-4.html. Raises
    UserError when a name is unknown, none is given or the folder is a file; nothing is written
    then.
    """
    if not figures:
        raise UserError(f"reproduce: name at least one figure of {', '.join(names())}")
    recipes = {recipe.name: recipe for name in figures for recipe in find(name)}.values()
    drawn = ensure_directory(out / "quick" if is_quick else out)
    trials = [trial for recipe in recipes for trial in recipe.trials(is_quick)]
    measured = _measure(trials, out, is_quick, means)
    made = [recipe.make(measured) for recipe in recipes]
    paths = _write_figures(made, drawn)
    return paths + [recipe.page(drawn, made) for recipe in recipes if recipe.page]


def reproduce_sweep(name: str, sweep: Sweep, out: Path, means: Means = _THREADS) -> list[Path]:
    """Measure a sweep and write its figure under this name; else as `reproduce`."""
    ensure_directory(out)
    measured = _measure(sweep.trials, out, False, means)
    return write_figure(sweep_figure(name, sweep, measured.results), out)


def _measure(trials: Sequence[Trial], out: Path, is_quick: bool, means: Means) -> Run:
    templates = pixels_of((trial.template for trial in trials), means.cache)
    results = run(trials, templates, out / "trials", means.workers, means.scheduler)
    return Run(is_quick, results, templates, means.cache)


def _write_figures(figures: Sequence[Figure], out: Path) -> list[Path]:
    paths: list[Path] = []
    with progress("Drawing figures", len(figures), "figure") as advance:
        for written in side_by_side([partial(write_figure, figure, out) for figure in figures]):
            paths += written
            advance()
    return paths


def side_by_side(tasks: Sequence[Callable[[], Result]]) -> Iterator[Result]:
    """Yield what tasks return, in their order, done in several processes at once.

    Drawing holds Python's lock, and figures hold functions and arrays that cannot be sent to
    another process; one that is forked has them. Where processes are not forked, or Mitsuba runs,
    whose threads do not survive it, one thing is done after the other. A process ends with the one
    that forked it. What tasks return must be fit to be sent.
    """
    global _tasks
    workers = min(os.cpu_count() or 1, len(tasks))
    mitsuba = sys.modules.get("mitsuba")
    if workers < 2 or sys.platform != "linux" or (mitsuba and mitsuba.variant()):
        yield from (task() for task in tasks)
        return
    _tasks = tasks
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("fork"), _watch)
    try:
        with warnings.catch_warnings():
            # Python from 3.12 on warns of forking where there are threads; those of NumPy survive.
            warnings.filterwarnings("ignore", "This process .* is multi-threaded")
            yield from pool.map(_do, range(len(tasks)))
    finally:
        # who interrupts does not wait for what is half done
        pool.shutdown(wait=False, cancel_futures=True)
        _tasks = ()


def _watch() -> None:
    """End this process with the one that forked it, also where that is killed."""
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()  # reads the end of a pipe that the parent alone holds open
    os._exit(1)


def _do(number: int) -> Any:
    return _tasks[number]()
