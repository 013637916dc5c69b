"""`megalopta spadcam emulate`."""

from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from megalopta.cli.command import Verbs, add_verb, finite, stopped_by_signals, whole
from megalopta.core.errors import UserError
from megalopta.core.progress import say

if TYPE_CHECKING:
    from megalopta.camera.emulated import Faults, Stimulus
    from megalopta.sensor import Sensor

_LIMITS = {
    "photons": (0.0, 1e15),
    "step_s": (1e-3, 1e9),
    "speed": (0.0, 100.0),
    "lux": (0.0, 1e6),
    "device_seed": (0, 2**32 - 1),
}
_FAULTS = {
    "noise": "probability of a byte to have a bit flipped",
    "lost": "probability of a byte to be lost",
    "burst_s": "hold bytes back, and send them together this often (s)",
    "drift_ppm": "how much too fast the camera's clock goes (1e-6)",
    "stall_every_s": "stop sending this often (s)",
    "stall_s": "for how long (s)",
    "unplug_every_s": "unplug the camera after this time (s), and plug it in again",
    "unplug_s": "for how long it is unplugged (s, default: 0.5)",
}

_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "--stimulus": {
        "default": "flat",
        "help": "what it looks at: dark, flat, steps, plate, or the folder of a rendered dataset "
        "(default: flat)",
    },
    "--photons": {
        "type": finite,
        "nargs": "+",
        "metavar": "HZ",
        "help": "photons per second on a pixel at 700 nm, of flat (default: 5e6) or one after the "
        "other of steps (default: 0 to 2e7)",
    },
    "--step-s": {
        "type": finite,
        "default": 5.0,
        "help": "how long each of steps lasts (s, default: 5)",
    },
    "--speed": {"type": finite, "default": 5.0, "help": "of the plate (mm/s, default: 5)"},
    "--lux": {"type": finite, "help": "of a dataset: light level (lux)"},
    "--sensor": {"default": "spadcam", "help": "preset or YAML file (default: spadcam)"},
    "--device-seed": {"type": whole, "help": "which device of this kind"},
    "--seed": {"type": whole, "default": 0, "help": "of photons, noise and faults"},
    "--serial": {"default": "EMULATED", "help": "the camera's serial number"},
    "--link": {"type": Path, "help": "symbolic link to keep to the terminal"},
}


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "emulate the camera on a pseudo-terminal, whose path is printed, until interrupted"
    command = add_verb(verbs, "emulate", purpose, _run)
    for name, how in _OPTIONS.items():
        command.add_argument(name, **how)
    for name, text in _FAULTS.items():
        command.add_argument(f"--{name.replace('_', '-')}", type=finite, help=text)


def _run(options: Namespace) -> None:
    from megalopta.camera.emulated import EmulatedCamera, EmulatedPort

    _check_limits(options)
    faults = _faults(options)
    camera = EmulatedCamera(_sensor(options), _stimulus(options), options.seed, options.serial)
    port = EmulatedPort(
        camera, faults, options.link, lambda path: print(options.link or path, flush=True)
    )
    port.run(stopped_by_signals())
    say(
        f"emulate: stopped; {port.dropped} packets were dropped while nothing read the line fast"
        " enough; a capture counts as missing only those between its first frame and its last"
    )


def _check_limits(options: Namespace) -> None:
    for name, (least, most) in _LIMITS.items():
        value = getattr(options, name)
        for each in value if isinstance(value, list) else [value]:
            if each is not None and not least <= each <= most:
                raise UserError(f"--{name.replace('_', '-')}: {each:g}; give {least:g} to {most:g}")


def _faults(options: Namespace) -> "Faults":
    from megalopta.camera.emulated import Faults

    given = {name: getattr(options, name) for name in _FAULTS}
    faults = Faults(**{name: value for name, value in given.items() if value is not None})
    faults.check()
    return faults


def _sensor(options: Namespace) -> "Sensor":
    from megalopta.camera.camera_settings import named_sensor
    from megalopta.sensor import changed

    sensor = named_sensor(options.sensor)
    if options.device_seed is None:
        return sensor
    return changed(sensor, device_seed=options.device_seed)


def _stimulus(options: Namespace) -> "Stimulus":
    from megalopta.camera.emulated import Flat, Plate, Rendered

    match options.stimulus:
        case "dark":
            return Flat()
        case "flat":
            return Flat(tuple(options.photons or (5e6,))[:1])
        case "steps":
            levels = options.photons or (0, 1e6, 2e6, 5e6, 1e7, 2e7)
            return Flat(tuple(map(float, levels)), options.step_s)
        case "plate":
            return Plate(options.speed)
    folder = Path(options.stimulus)
    if not folder.is_dir():
        raise UserError(
            f"--stimulus: {options.stimulus}; give dark, flat, steps, plate or a dataset's folder"
        )
    return Rendered(folder, options.lux)
