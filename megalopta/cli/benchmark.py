"""`megalopta benchmark`: a verb of verbs, one in each file `benchmark_*.py` beside this one."""

from megalopta.cli.command import Verbs, add_group


def declare(verbs: Verbs) -> None:
    """Add the verb, and its own."""
    add_group(verbs, "benchmark", "measure how well methods find motion, and with how much light")
