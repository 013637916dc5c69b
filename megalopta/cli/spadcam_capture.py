"""`megalopta spadcam capture`."""

import signal
import threading
from argparse import Namespace
from datetime import datetime
from pathlib import Path

from megalopta.cli.command import Verbs, add_verb, finite, whole


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "record the camera until interrupted, or until there is enough"
    command = add_verb(verbs, "capture", purpose, _run)
    command.add_argument("--port", help="serial port (default: the only Teensy on USB)")
    command.add_argument("--usb-serial", help="USB serial number of the camera, instead")
    command.add_argument(
        "--wait", type=finite, default=30.0, help="for a port to appear (s, default: 30)"
    )
    command.add_argument("--out", type=Path, help="new folder (default: recordings/KIND-DATE-TIME)")
    command.add_argument(
        "--kind", default="scene", help="what is recorded, such as dark, flat (default: scene)"
    )
    command.add_argument("--frames", type=whole, help="stop after so many")
    command.add_argument("--seconds", type=finite, help="stop after this time (s)")
    command.add_argument(
        "--exposure", type=finite, default=0.05, help="of a frame (s, default: 0.05)"
    )
    command.add_argument(
        "--rate", type=finite, default=10.0, help="frames per second (default: 10)"
    )
    command.add_argument(
        "--step-bias",
        type=whole,
        default=2048,
        help="code of the DAC that biases the counters' step, 0 to 4095 (default: 2048)",
    )
    command.add_argument(
        "--rows",
        type=whole,
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
    from megalopta.camera.camera_settings import CaptureSettings, named_sensor
    from megalopta.camera.capturing import capture
    from megalopta.camera.port import find_port
    from megalopta.camera.view import recorded_line, viewing

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
    print(recorded_line(out, record))
