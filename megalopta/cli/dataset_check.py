"""`megalopta dataset check`."""

import sys
from argparse import Namespace

from megalopta.cli.command import Verbs, add_dataset, add_verb, at_least


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "verify a dataset: hashes, shapes, wholeness, and the truth derived another way"
    command = add_verb(verbs, "check", purpose, _run)
    add_dataset(command)
    text = "sequences of which flow is derived again from depth and poses (default: 3)"
    command.add_argument("--truth", type=at_least(0), default=3, metavar="N", help=text)


def _run(options: Namespace) -> None:
    from megalopta.verification.files import run_check_files

    if not run_check_files(options.dataset, options.truth):
        sys.exit(1)
