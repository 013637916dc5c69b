"""`megalopta spadcam`: a verb of verbs, one in each file `spadcam_*.py` beside this one."""

from megalopta.cli.command import Verbs, add_group


def declare(verbs: Verbs) -> None:
    """Add the verb, and its own."""
    add_group(verbs, "spadcam", "record, calibrate and emulate the camera SPADCAM")
