"""`megalopta hello`."""

from argparse import Namespace

from megalopta.cli.command import Verbs, add_verb


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    add_verb(verbs, "hello", "say hello", _run)


def _run(options: Namespace) -> None:
    print("hello")
