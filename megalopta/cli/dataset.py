"""`megalopta dataset`: a verb of verbs, one in each file `dataset_*.py` beside this one."""

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from megalopta.cli.command import Verbs, add_group


def declare(verbs: Verbs) -> None:
    """Add the verb, and its own."""
    group = add_group(verbs, "dataset", "make, check and show a dataset of many sequences")
    for found in iter_modules([str(Path(__file__).parent)]):
        if found.name.startswith("dataset_"):
            import_module(f"megalopta.cli.{found.name}").declare(group)
