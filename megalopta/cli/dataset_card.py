"""`megalopta dataset card`."""

from argparse import Namespace

from megalopta.cli.command import Verbs, add_dataset, add_verb


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "write README.md: what a dataset holds, with statistics and pictures"
    command = add_verb(verbs, "card", purpose, _run)
    add_dataset(command)


def _run(options: Namespace) -> None:
    from megalopta.report.dataset_card import write_card

    print(write_card(options.dataset))
