"""`megalopta spadcam recover`."""

from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import Verbs, add_verb


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "read raw.bin of a broken recording back into a recording"
    command = add_verb(verbs, "recover", purpose, _run)
    command.add_argument("raw", type=Path, help="folder of the recording, or its raw.bin")
    command.add_argument(
        "--out", type=Path, help="new folder (default: the recording's own, whose counts it makes)"
    )
    command.add_argument(
        "--sensor",
        default="spadcam",
        help="preset or YAML file with the counters' nominal step, where counts.zarr is lost "
        "(default: spadcam)",
    )


def _run(options: Namespace) -> None:
    from megalopta.camera.capturing import recorded_line
    from megalopta.camera.recovering import recover

    print(recorded_line(*recover(options.raw, options.out, options.sensor)))
