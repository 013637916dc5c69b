"""`megalopta spadcam list`."""

from argparse import Namespace

from megalopta.cli.command import Verbs, add_verb


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    add_verb(verbs, "list", "list serial ports on USB, and whether they can be opened", _run)


def _run(options: Namespace) -> None:
    from megalopta.camera.link import port_lines

    lines = list(port_lines())
    print("\n".join(lines) or "no serial port on USB; plug the camera in")
