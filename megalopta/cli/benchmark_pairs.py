"""`megalopta benchmark pairs`."""

from argparse import ArgumentTypeError, Namespace
from pathlib import Path

from megalopta.cli.command import Verbs, add_out, add_verb, at_least
from megalopta.errors import UserError

_WIDTH = 150  # of the table, whatever the terminal's
_FLUXES = "1,3,10,30,100,1000"
_DRAWS_OF_ONE = 5


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "measure flow methods on photons drawn from photographs with true flow"
    command = add_verb(verbs, "pairs", purpose, _run)
    text = (
        "two pictures and their flow (.flo or another format); or a folder in the layout of"
        " Middlebury, Sintel, KITTI or a dataset"
    )
    command.add_argument("paths", type=Path, nargs="+", metavar="PATH", help=text)
    text = "names, module:function or ONNX files (default: all that do with two frames)"
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
    from rich.table import Table

    from megalopta.experiments import errors_of_pairs, pairs_below, spread, write_board

    if len(options.paths) == 1:
        pairs = spread(pairs_below(options.paths[0]), options.pairs)
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
    over = "scenes" if len(pairs) > 1 else "draws"
    table = Table(
        "method",
        *(f"{flux:g}" for flux in options.photons),
        title=f"Median endpoint error (px) over photons per pixel, 95 % over {over}",
    )
    for each in errors:
        ends = zip(each.mean, *each.interval, strict=True)
        cells = (f"{mean:.2f} ({low:.2f} … {high:.2f})" for mean, low, high in ends)
        table.add_row(each.detector.name, *cells)
    Console(width=_WIDTH).print(table)
    print(options.out)
