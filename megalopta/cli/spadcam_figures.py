"""`megalopta spadcam figures`."""

from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import Verbs, add_out, add_verb


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "the dissertation's figures 2.14 to 2.19 from recordings of the moving plate"
    command = add_verb(verbs, "figures", purpose, _run)
    command.add_argument(
        "recordings",
        nargs="+",
        metavar="RECORDING@SPEED",
        help="folders of recordings (--rate 10 --exposure 0.1), and the plate's speed in mm/s; "
        "without, it rests with its edge in the middle",
    )
    command.add_argument(
        "--device",
        type=Path,
        help="device file that simulates beside them (default: the recordings' nominal sensor)",
    )
    command.add_argument(
        "--own-light",
        action="store_true",
        help="simulate in the light that open and hidden pixels of the recording of the slowest "
        "plate show (default: that of the dissertation, 65 photons per frame and pixel)",
    )
    add_out(command, "out/plate")


def _run(options: Namespace) -> None:
    from megalopta.camera.recording import Source
    from megalopta.reproduction.chapter2_captured import reproduce_captured

    sources = [Source.parse(text) for text in options.recordings]
    for path in reproduce_captured(
        sources, options.out, options.device, own_light=options.own_light
    ):
        print(path)
