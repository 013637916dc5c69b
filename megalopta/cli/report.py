"""`megalopta report`."""

from argparse import Namespace

from megalopta.cli.command import Verbs, add_dataset, add_verb

_SHOWN = 24
"""Sequences of many."""


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = (
        "write report.html from what a dataset holds, one file without outside links; of many "
        "sequences README.md and index.html"
    )
    add_dataset(add_verb(verbs, "report", purpose, _run))


def _run(options: Namespace) -> None:
    from megalopta.dataset.layout import is_of_many
    from megalopta.dataset.store import open_sequence
    from megalopta.report.dataset_card import write_card, write_view
    from megalopta.report.page import write_report

    if is_of_many(options.dataset):
        print(write_card(options.dataset))
        print(write_view(options.dataset, _SHOWN))
    else:
        print(write_report(open_sequence(options.dataset)))
