"""`megalopta spadcam compare`."""

from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from megalopta.cli.command import Verbs, add_out, add_verb, at_least, positive
from megalopta.cli.spadcam_calibrate import add_recordings

_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "--device": {"type": Path, "required": True, "help": "device file of the model"},
    "--scene": {
        "default": "levels",
        "help": "levels: darkness and even light (default); plate: the moving plate, LIGHT is then "
        "its speed in mm/s; or a dataset's folder, or a configuration, which is rendered beside "
        "the page: LIGHT is then the light level in lux, none: that of the rendering",
    },
    "--format": {
        "choices": ["npy", "spad512", "swissspad2", "swissspad2_whole", "spc3", "tiff"],
        "help": "of recordings of other cameras (default: as their content says, .bin: spad512); "
        "their exposure follows: FILE@LIGHT:SECONDS",
    },
    "--margin": {
        "type": positive,
        "default": 0.05,
        "help": "relative difference that does not matter (default: 0.05)",
    },
    "--seed": {"type": at_least(0), "default": 0, "help": "of the simulation (default: 0)"},
    "--own-light": {
        "action": "store_true",
        "help": "of plate: simulate in the light that the recording's open and hidden pixels show "
        "(default: that of the dissertation, 65 photons per frame and pixel)",
    },
}


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "recordings beside what the device's model makes of the same stimulus"
    command = add_verb(verbs, "compare", purpose, _run)
    add_recordings(command)
    for name, how in _OPTIONS.items():
        command.add_argument(name, **how)
    add_out(command, "comparison.html", "page")


def _run(options: Namespace) -> None:
    from megalopta.camera.device_comparison import CompareSettings, compare_captured
    from megalopta.camera.recording import Beam, Source

    sources = [Source.parse(text, options.format) for text in options.recordings]
    beam = Beam(options.wavelength_nm, options.beam_area_mm2)
    asked = CompareSettings(options.scene, beam, options.margin, options.seed, options.own_light)
    print(compare_captured(sources, options.device, options.out, asked))
    print(options.out)
