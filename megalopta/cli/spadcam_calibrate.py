"""`megalopta spadcam calibrate`."""

from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import Command, Verbs, add_verb, positive


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "a device file from recordings in the dark and under even light"
    command = add_verb(verbs, "calibrate", purpose, _run)
    add_recordings(command)
    command.add_argument(
        "--out", type=Path, default=Path("device.yaml"), help="device file (default: device.yaml)"
    )
    command.add_argument(
        "--preset", default="spadcam", help="sensor whose other fields hold (default: spadcam)"
    )


def add_recordings(command: Command) -> None:
    """Add recordings and what is known of their light."""
    command.add_argument(
        "recordings",
        nargs="+",
        metavar="RECORDING[#FIRST-END][@LIGHT]",
        help="folders of recordings, or of each some frames, such as steps#0-100@1e7; LIGHT in "
        "photons per second on a pixel, none: in the dark",
    )
    command.add_argument(
        "--wavelength-nm", type=positive, help="wavelength of the light; without, it is relative"
    )
    command.add_argument(
        "--beam-area-mm2",
        type=positive,
        help="area of an even beam; LIGHT is then its power in watts",
    )


def _run(options: Namespace) -> None:
    from megalopta.camera.calibration import calibrate_recordings
    from megalopta.camera.recording import Beam, Source

    sources = [Source.parse(text) for text in options.recordings]
    beam = Beam(options.wavelength_nm, options.beam_area_mm2)
    print(calibrate_recordings(sources, options.out, beam=beam, base=options.preset))
    print(options.out)
    print(options.out.with_suffix(".html"))
