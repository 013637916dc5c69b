"""`megalopta sense`."""

from megalopta.cli.command import Verbs
from megalopta.cli.stage_command import add_later_stage


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "expose every sensor at every light level: photon counts to Zarr"
    add_later_stage(verbs, "sense", purpose)
