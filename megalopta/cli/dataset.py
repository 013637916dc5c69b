"""`megalopta dataset`: a verb of verbs, one in each file `dataset_*.py` beside this one."""

from megalopta.cli.command import Verbs, add_group


def declare(verbs: Verbs) -> None:
    """Add the verb, and its own."""
    add_group(verbs, "dataset", "make, check and show a dataset of many sequences")
