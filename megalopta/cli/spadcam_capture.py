"""`megalopta spadcam capture`."""

import signal
import threading
from argparse import Namespace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from megalopta.cli.command import Verbs, add_verb
from megalopta.errors import UserError

if TYPE_CHECKING:
    from megalopta.spadcam import RecordingSettings

_NO_CLOCK_S = 1.0
"""Mean error of times that no line holds back: only of a clock beyond what a quartz may be off."""


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "record the camera until interrupted, or until there is enough"
    command = add_verb(verbs, "capture", purpose, _run)
    command.add_argument("--port", help="serial port (default: the only Teensy on USB)")
    command.add_argument("--usb-serial", help="USB serial number of the camera, instead")
    command.add_argument(
        "--wait", type=float, default=30.0, help="for a port to appear (s, default: 30)"
    )
    command.add_argument("--out", type=Path, help="new folder (default: recordings/KIND-DATE-TIME)")
    command.add_argument(
        "--kind", default="scene", help="what is recorded, such as dark, flat (default: scene)"
    )
    command.add_argument("--frames", type=int, help="stop after so many")
    command.add_argument("--seconds", type=float, help="stop after this time (s)")
    command.add_argument(
        "--exposure", type=float, default=0.05, help="of a frame (s, default: 0.05)"
    )
    command.add_argument("--rate", type=float, default=10.0, help="frames per second (default: 10)")
    command.add_argument(
        "--step-bias",
        type=int,
        default=2048,
        help="code of the DAC that biases the counters' step, 0 to 4095 (default: 2048)",
    )
    command.add_argument(
        "--rows",
        type=int,
        nargs=2,
        default=(0, 16),
        metavar=("FIRST", "END"),
        help="rows that are read (default: 0 16, all)",
    )
    command.add_argument(
        "--sensor",
        default="spadcam",
        help="preset or YAML file with the counters' nominal step (default: spadcam)",
    )


def _run(options: Namespace) -> None:
    from megalopta.spadcam import CaptureSettings, capture, find_port, named_sensor, viewing

    for name in ("frames", "seconds"):
        value = getattr(options, name)
        if value is not None and value <= 0:
            raise UserError(f"--{name}: {value:g}; give more than 0")
    settings = CaptureSettings(
        sensor=named_sensor(options.sensor),
        kind=options.kind,
        exposure_s=options.exposure,
        frame_rate_hz=options.rate,
        step_bias=options.step_bias,
        row_window=tuple(options.rows),
        frames=options.frames,
        seconds=options.seconds,
    )
    out = options.out or Path("recordings") / f"{options.kind}-{datetime.now():%Y%m%d-%H%M%S}"
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with viewing() as show:
        record = capture(
            lambda: options.port or find_port(options.usb_serial),
            out,
            settings,
            stop,
            show,
            wait_s=options.wait,
        )
    print(
        f"{out}: {record.frames} frames of {record.serial_number}, {record.gaps} gaps "
        f"({record.missing_frames} frames missing), {record.damaged_packets} packets damaged"
        f"{_how_sure_times_are(record)}"
    )


def _how_sure_times_are(record: "RecordingSettings") -> str:
    error_s = record.connections[-1].error_s if record.connections else None
    if not error_s:
        return ""
    if error_s > _NO_CLOCK_S:
        return ", times by the camera's clock alone: it goes otherwise than this machine's"
    return f", times to {error_s * 1e3:.2g} ms"
