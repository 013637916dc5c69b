"""`megalopta reproduce`."""

from argparse import Namespace

from megalopta.cli.command import Verbs, add_out, add_verb, add_workers


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "draw figures and tables of the dissertation again, as PNG, SVG, CSV and JSON"
    command = add_verb(verbs, "reproduce", purpose, _run)
    command.add_argument(
        "figures",
        nargs="+",
        metavar="FIGURE",
        help="such as fig-2.9 or table-3.1, chapter-4, or all",
    )
    add_out(command, "out/figures")
    command.add_argument("--quick", action="store_true", help="draw Chapter 4 coarsely, in seconds")
    add_workers(command)


def _run(options: Namespace) -> None:
    from megalopta.reproduction.drawing import Means, reproduce

    means = Means(options.workers, options.cache, options.scheduler)
    for path in reproduce(options.figures, options.out, options.quick, means):
        print(path)
