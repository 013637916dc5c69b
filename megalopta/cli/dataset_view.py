"""`megalopta dataset view`."""

from argparse import Namespace

from megalopta.cli.command import Verbs, add_dataset, add_verb, at_least


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "write index.html, a contact sheet with clips of light, counts, flow and depth"
    command = add_verb(verbs, "view", purpose, _run)
    add_dataset(command)
    text = "sequences to show, spread evenly (default: 24)"
    command.add_argument("--sequences", type=at_least(1), default=24, metavar="N", help=text)


def _run(options: Namespace) -> None:
    from megalopta.report.dataset_card import write_view

    print(write_view(options.dataset, options.sequences))
