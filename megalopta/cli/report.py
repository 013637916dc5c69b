"""`megalopta report`."""

from argparse import Namespace

from megalopta.cli.command import Verbs, add_dataset, add_verb


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "write report.html, one file without outside links, from what a dataset holds"
    add_dataset(add_verb(verbs, "report", purpose, _run))


def _run(options: Namespace) -> None:
    from megalopta.dataset.store import open_sequence
    from megalopta.report.page import write_report

    print(write_report(open_sequence(options.dataset)))
