"""`megalopta benchmark photons`."""

from megalopta.cli.command import Verbs
from megalopta.cli.stage_command import add_later_stage


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "find the photons per frame that each detector needs (N_2b)"
    add_later_stage(verbs, "photons", purpose, stage="benchmark")
