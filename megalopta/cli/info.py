"""`megalopta info`."""

from argparse import Namespace

from megalopta.cli.command import Verbs, add_verb


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "show versions, the rendering variant and what would make it faster"
    add_verb(verbs, "info", purpose, _run)


def _run(options: Namespace) -> None:
    from megalopta.generation.versions import describe

    print(describe())
