"""`megalopta benchmark` and its verbs: how well methods find motion, and with how much light."""

from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from megalopta.cli.command import (
    DATASET,
    THREADS,
    VERBS,
    Verb,
    at_least,
    numbers,
    option,
    out,
    settings_of,
    switch,
    verb,
)
from megalopta.cli.stages import REDO, run_later_stage, settings_of_stage
from megalopta.core.errors import UserError

if TYPE_CHECKING:
    from rich.table import Table

    from megalopta.benchmark.table import Interval
    from megalopta.benchmark.whole_frames import Board
    from megalopta.config.settings import Settings

_WIDTH = 150  # of tables, whatever the terminal's
_FLUXES = "1,3,10,30,100,1000"
_DRAWS_OF_ONE = 5
_OF_SWEEPS = ("allow_code", "out", "cache")

VERBS["benchmark"] = Verb("measure how well methods find motion, and with how much light")


@verb(
    "benchmark pairs",
    "rank flow methods on photographs with true flow, over the photons drawn from them",
    option(
        "paths",
        "two pictures and their flow (.flo or another format); or a folder in the layout of"
        " Middlebury, Sintel, KITTI or a dataset",
        type=Path,
        nargs="+",
        metavar="PATH",
    ),
    option(
        "--methods",
        "names, module:function or ONNX files; DIS √ is DIS on roots of counts (default: all"
        " that do with two frames)",
        metavar="A,B",
    ),
    option(
        "--photons",
        f"photons per pixel and frame, on average (default: {_FLUXES})",
        type=numbers,
        default=_FLUXES,
        metavar="N,N",
    ),
    option(
        "--pairs",
        "of a folder, at most so many pairs, evenly spread (default: 20)",
        type=at_least(1),
        default=20,
        metavar="N",
    ),
    option(
        "--draws",
        f"draws of the photons of each pair (default: 1; of one pair {_DRAWS_OF_ONE})",
        type=at_least(1),
        metavar="N",
    ),
    out("pairs.csv", "file of the errors"),
)
def _pairs(options: Namespace) -> None:
    from rich.console import Console

    from megalopta.benchmark.methods import BLOCK_PX
    from megalopta.benchmark.pairs_on_disk import evenly_spread, pairs_below
    from megalopta.benchmark.whole_frames import errors_of_pairs, write_board

    if len(options.paths) == 1:
        pairs = evenly_spread(pairs_below(options.paths[0]), options.pairs)
    elif len(options.paths) == 3:
        pairs = {options.paths[0].stem: tuple(options.paths)}
    else:
        raise UserError(
            f"benchmark pairs: {len(options.paths)} paths; give a folder, or two pictures and"
            " their flow"
        )
    draws = options.draws or (_DRAWS_OF_ONE if len(pairs) == 1 else 1)
    methods = options.methods.split(",") if options.methods else None
    errors = errors_of_pairs(pairs, options.photons, methods, draws)
    write_board(options.out, errors)
    over = f", mean over {len(pairs)} pairs with 95 % over pairs" if len(pairs) > 1 else ""
    print(f"Errors of blocks of {BLOCK_PX} px over photons per pixel{over}:")
    console = Console(width=_WIDTH)
    for table in _tables(errors):
        console.print(table)
    print(options.out)


def _tables(board: "Board") -> "Iterator[Table]":
    """Yield a table of each measure: a line for each method, a column for each flux."""
    from rich.table import Table

    from megalopta.benchmark.whole_frames import FAR, FAR_PX, MEAN, MEDIAN

    for metric, title, factor, digits in (
        (MEDIAN, "median, px", 1, 2),
        (MEAN, "mean, px", 1, 2),
        (FAR, f"% beyond {FAR_PX:g} px", 100, 1),
    ):
        table = Table(title, *(f"{flux:g}" for flux in board.fluxes))
        for each in board.detectors:
            found = (board.over_scenes(metric, each, flux) for flux in board.fluxes)
            table.add_row(each.name, *(_cell(one, factor, digits) for one in found))
        yield table


def _cell(found: "Interval", factor: float, digits: int) -> str:
    """Return the mean over pairs, with its interval where there are several."""
    if found.low is None or found.high is None:
        return f"{factor * found.value:.{digits}f}"
    mean, low, high = (
        f"{factor * each:.{digits}f}" for each in (found.value, found.low, found.high)
    )
    return f"{mean} ({low} … {high})"


def _photon_settings() -> "Settings":
    from megalopta.benchmark.trial import Sweep

    return settings_of_stage("benchmark", Sweep)


@verb(
    "benchmark photons",
    "find how much light detectors need to agree with themselves, on a dataset or in a sweep",
    option(
        "dataset",
        "dataset folder; or a sweep's YAML file: trial, vary, values, sizes, templates",
        type=Path,
        metavar="DATASET or SWEEP",
    ),
    REDO,
    switch(
        "--allow-code",
        "run what a sweep names as module:function or ONNX file; otherwise it is refused",
    ),
    option("--out", "folder of a sweep's figure (default: out/sweeps)", type=Path),
    *THREADS,
    settings=_photon_settings,
)
def _photons(options: Namespace) -> None:
    is_sweep = options.dataset.suffix in (".yaml", ".yml") and not options.dataset.is_dir()
    unused = ("redo",) if is_sweep else _OF_SWEEPS
    for name in unused:
        if getattr(options, name):
            kind = "a dataset" if is_sweep else "a sweep"
            raise UserError(
                f"benchmark photons: --{name.replace('_', '-')} is for {kind}; leave it out"
            )
    if is_sweep:
        _run_sweep(options)
    else:
        run_later_stage("benchmark", options)


def _run_sweep(options: Namespace) -> None:
    from megalopta.benchmark.trial import load_sweep
    from megalopta.reproduction.drawing import Means, reproduce_sweep

    path, out = options.dataset, options.out or Path("out/sweeps")
    sweep = load_sweep(path, options.overrides, options.allow_code)
    means = Means(options.workers, options.cache, options.scheduler)
    for written in reproduce_sweep(path.stem, sweep, out, means):
        print(written)


@verb(
    "benchmark sequence",
    "rank flow methods on rendered sequences against the true motion, over the photons",
    DATASET,
    out("out/ranking"),
    settings=settings_of("benchmark.ranking_settings", "RankingSettings"),
)
def _sequence(options: Namespace) -> None:
    from megalopta.benchmark.ranking_run import run_ranking

    print(run_ranking(options.dataset, options.out, options.overrides))


@verb(
    "benchmark submit",
    "score flow that any program wrote, or methods, on pictures as they are: no photons",
    option(
        "flow",
        "folder of flow files (.flo, .flo5, .pfm, .npy or KITTI's PNG, px per frame), laid "
        "out as the truth is; or a method, such as DIS, module:function or an ONNX file, that is "
        "asked for the flow of the truth's pictures",
    ),
    option(
        "--truth",
        "folder of the true flow: a dataset, or one of Sintel, KITTI or Middlebury",
        type=Path,
        required=True,
    ),
    option("--program", "name of what wrote it (default: that of its folder)"),
    option("--leaderboard", "add the scores to this file, and show it", type=Path, metavar="FILE"),
    out("scores.json", "file of the scores"),
)
def _submit(options: Namespace) -> None:
    from rich.console import Console

    from megalopta.benchmark.scores import (
        add_entries,
        board_table,
        read_board,
        score_submission,
        score_table,
    )
    from megalopta.core import files

    if options.leaderboard:
        read_board(options.leaderboard)  # a damaged one is refused before the work
    scores = score_submission(options.flow, options.truth, options.program)
    files.write_text(options.out, scores.model_dump_json(indent=1) + "\n")
    console = Console(width=_WIDTH, markup=False, emoji=False)
    console.print(score_table(scores))
    print(options.out)
    if options.leaderboard:
        entries = add_entries(options.leaderboard, scores.overall)
        console.print(board_table(entries, scores.entries[0].truth_hash))
        print(options.leaderboard)
