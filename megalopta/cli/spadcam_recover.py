"""`megalopta spadcam recover`."""

from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import Verbs, add_verb, finite


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "read raw.bin of a broken recording back into a recording"
    command = add_verb(verbs, "recover", purpose, _run)
    command.add_argument("raw", type=Path, help="folder of the recording, or its raw.bin")
    command.add_argument(
        "--out", type=Path, help="new folder (default: the recording's own, whose counts it makes)"
    )
    command.add_argument("--kind", help="what was recorded, where recording.yaml is lost")
    command.add_argument(
        "--exposure", type=finite, help="of a frame (s), where raw.bin does not say it"
    )
    command.add_argument(
        "--rate", type=finite, help="frames per second, where raw.bin does not say it"
    )
    command.add_argument("--sensor", help="preset or YAML file with the counters' nominal step")


def _run(options: Namespace) -> None:
    from megalopta.camera.recovering import recover
    from megalopta.camera.replay import Told
    from megalopta.camera.view import recorded_line

    told = Told(options.kind, options.exposure, options.rate, options.sensor)
    path, record, unknown = recover(options.raw, options.out, told)
    print(recorded_line(path, record))
    if unknown:
        print(f"not known: {', '.join(unknown)}")
