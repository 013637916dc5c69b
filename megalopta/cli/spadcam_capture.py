"""`megalopta spadcam capture`."""

from argparse import Namespace
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from megalopta.cli.command import Verbs, add_verb, finite, stopped_by_signals, whole

_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "--port": {"help": "serial port (default: the only Teensy on USB)"},
    "--usb-serial": {"help": "USB serial number of the camera, instead"},
    "--wait": {"type": finite, "default": 30.0, "help": "for a port to appear (s, default: 30)"},
    "--out": {"type": Path, "help": "new folder (default: recordings/KIND-DATE-TIME)"},
    "--kind": {"default": "scene", "help": "what is recorded: dark, flat, … (default: scene)"},
    "--frames": {"type": whole, "help": "stop after so many"},
    "--seconds": {"type": finite, "help": "stop after this time (s)"},
    "--exposure": {"type": finite, "default": 0.05, "help": "of a frame (s, default: 0.05)"},
    "--rate": {"type": finite, "default": 10.0, "help": "frames per second (default: 10)"},
    "--step-bias": {
        "type": whole,
        "default": 2048,
        "help": "code of the DAC that biases the counters' step, 0 to 4095 (default: 2048)",
    },
    "--rows": {
        "type": whole,
        "nargs": 2,
        "default": (0, 16),
        "metavar": ("FIRST", "END"),
        "help": "rows that are read (default: 0 16, all)",
    },
    "--sensor": {
        "default": "spadcam",
        "help": "preset or YAML file with the counters' nominal step (default: spadcam)",
    },
}


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "record the camera until interrupted, or until there is enough"
    command = add_verb(verbs, "capture", purpose, _run)
    for name, how in _OPTIONS.items():
        command.add_argument(name, **how)


def _run(options: Namespace) -> None:
    from megalopta.camera.camera_settings import CaptureSettings, named_sensor
    from megalopta.camera.capturing import capture, recorded_line, viewing
    from megalopta.camera.link import find_port

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
    stop = stopped_by_signals()

    def find() -> str:
        return options.port or find_port(options.usb_serial)

    with viewing() as show:
        record = capture(find, out, settings, stop, show, wait_s=options.wait)
    print(recorded_line(out, record))
