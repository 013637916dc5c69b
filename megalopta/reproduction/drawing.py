"""Chapter 4 of the dissertation with the models of this package: its sweeps and Table 4.1.

Each becomes a picture to look at (PNG), one to print (SVG) and its numbers (CSV, and JSON with
parameters and intervals). The bytes depend only on the versions of this package, of NumPy and of
matplotlib. Figures of Chapters 2 and 3 are scripts in `examples/dissertation`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from megalopta.benchmark.runner import Results, run
from megalopta.benchmark.trial import Sweep, Trial, template_pixels
from megalopta.core.errors import UserError
from megalopta.core.folders import ensure_directory
from megalopta.core.progress import progress
from megalopta.reproduction.chapter4_curves import SWEEPS, curve_figure, in_form
from megalopta.reproduction.chapter4_table import TABLE, table_figure, table_trials, write_page
from megalopta.reproduction.picture import write_figure
from megalopta.reproduction.sweep_figure import sweep_figure

CHAPTER = "chapter-4"
"""Name of all figures together"""
NAMES = (*SWEEPS, TABLE)


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

    "chapter-4" names all. Results of the flow benchmark are kept in the folder `trials` of `out`,
    and not measured again. Quick forms, with fewer trials, go to its folder `quick`: complete ones
    are kept. Table 4.1 comes with a page, chapter-4.html. Raises UserError if a name is unknown or
    the folder is a file; nothing is written then.
    """
    for name in figures:
        if name not in (CHAPTER, *NAMES):
            raise UserError(
                f"reproduce: no figure {name!r}; give {CHAPTER} or some of {', '.join(NAMES)}; "
                "examples/dissertation has the figures of Chapters 2 and 3"
            )
    chosen = [name for name in NAMES if name in figures or CHAPTER in figures]
    drawn = ensure_directory(out / "quick" if is_quick else out)
    trials = [
        trial
        for name in chosen
        for trial in (
            table_trials(is_quick) if name == TABLE else in_form(SWEEPS[name], is_quick).trials
        )
    ]
    results = _measure(trials, out, means)
    made, paths = [], []
    with progress("Drawing figures", len(chosen), "figure") as advance:
        for name in chosen:
            figure = (
                table_figure(results, is_quick)
                if name == TABLE
                else curve_figure(name, results, is_quick)
            )
            if is_quick:
                title, details = f"{figure.title} (quick form)", {**figure.details, "quick": True}
                figure = replace(figure, title=title, details=details)
            made.append(figure)
            paths += write_figure(figure, drawn)
            advance()
    return [*paths, write_page(drawn, made)] if TABLE in chosen else paths


def reproduce_sweep(name: str, sweep: Sweep, out: Path, means: Means = _THREADS) -> list[Path]:
    """Measure a sweep and write its figure under this name; otherwise as `reproduce`."""
    ensure_directory(out)
    return write_figure(sweep_figure(name, sweep, _measure(sweep.trials, out, means)), out)


def _measure(trials: Sequence[Trial], out: Path, means: Means) -> Results:
    templates = template_pixels((trial.template for trial in trials), means.cache)
    return run(trials, templates, out / "trials", means.workers, means.scheduler)
