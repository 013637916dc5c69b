"""`megalopta benchmark pairs`."""

from argparse import ArgumentTypeError, Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from megalopta.cli.command import Verbs, add_out, add_verb, at_least
from megalopta.core.errors import UserError

if TYPE_CHECKING:
    from rich.table import Table

    from megalopta.benchmark.table import Interval
    from megalopta.benchmark.whole_frames import Board

_WIDTH = 150  # of the table, whatever the terminal's
_FLUXES = "1,3,10,30,100,1000"
_DRAWS_OF_ONE = 5


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "rank flow methods on photographs with true flow, over the photons drawn from them"
    command = add_verb(verbs, "pairs", purpose, _run)
    text = (
        "two pictures and their flow (.flo or another format); or a folder in the layout of"
        " Middlebury, Sintel, KITTI or a dataset"
    )
    command.add_argument("paths", type=Path, nargs="+", metavar="PATH", help=text)
    text = (
        "names, module:function or ONNX files; DIS √ is DIS on roots of counts (default: all that"
        " do with two frames)"
    )
    command.add_argument("--methods", metavar="A,B", help=text)
    text = f"photons per pixel and frame, on average (default: {_FLUXES})"
    command.add_argument("--photons", type=_numbers, default=_FLUXES, metavar="N,N", help=text)
    text = "of a folder, at most so many pairs, evenly spread (default: 20)"
    command.add_argument("--pairs", type=at_least(1), default=20, metavar="N", help=text)
    text = f"draws of the photons of each pair (default: 1; of one pair {_DRAWS_OF_ONE})"
    command.add_argument("--draws", type=at_least(1), metavar="N", help=text)
    add_out(command, "pairs.csv", "file of the errors")


def _numbers(text: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if not numbers or not all(0 < number <= 1e9 for number in numbers):
        raise ArgumentTypeError(f"{text!r}; give numbers above 0 and commas, such as {_FLUXES}")
    return numbers


def _run(options: Namespace) -> None:
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
    print(f"Errors of blocks of {BLOCK_PX} px over photons per pixel{_over(len(pairs))}:")
    console = Console(width=_WIDTH)
    for table in _tables(errors):
        console.print(table)
    print(options.out)


def _over(pairs: int) -> str:
    return f", mean over {pairs} pairs with 95 % over pairs" if pairs > 1 else ""


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
