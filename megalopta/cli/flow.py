"""`megalopta flow`."""

from megalopta.cli.command import Verbs
from megalopta.cli.stage_command import add_later_stage


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "run the motion detectors on the counts and compare with the truth"
    add_later_stage(verbs, "flow", purpose)
