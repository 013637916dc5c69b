"""`megalopta spadcam`: record, calibrate, compare and emulate the camera."""

from argparse import Namespace
from collections.abc import Iterator
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from megalopta.cli.command import (
    FRAME_KINDS,
    VERBS,
    Verb,
    at_least,
    chosen,
    option,
    out,
    out_file,
    positive,
    stopped_by_signals,
    verb,
    within,
)
from megalopta.core.errors import UserError, refused_as
from megalopta.core.progress import say, step

if TYPE_CHECKING:
    from megalopta.camera.emulator import Film

_RECORDINGS = (
    option(
        "recordings RECORDING[@LIGHT[:SECONDS]]",
        "recordings, or folders of them, with LIGHT in photons per second and pixel, and the "
        "exposure; without: by recording.yaml, header or name, such as flat_2e7_10us, else dark; "
        "or a .yaml list",
        nargs="+",
    ),
    option(
        "--wavelength-nm",
        "wavelength of the light (nm); without it, efficiency is relative",
        positive,
    ),
    option("--beam-area-mm2", "area of a uniform beam; LIGHT is then its power in watts", positive),
    option(
        "--format",
        "format of other cameras' recordings (default: by content, .bin: spad512)",
        choices=FRAME_KINDS,
    ),
)
"""Options for recordings and their light."""

VERBS["spadcam"] = Verb("calibrate and compare photon-counting cameras; record and emulate SPADCAM")


@verb("spadcam list", "list USB serial ports, and whether they can be opened")
def _list(options: Namespace) -> list[str]:
    from megalopta.camera.link import port_lines

    return list(port_lines()) or ["no USB serial port; plug the camera in"]


@verb(
    "spadcam capture",
    "record the camera until interrupted, or for --frames or --seconds",
    option("--port", "serial port (default: the only Teensy on USB)"),
    option("--wait", "time to wait for the port, s", within(0.0, 604_800.0), 30.0),
    option("--out", "new folder (default: recordings/KIND-DATE-TIME)", Path),
    option("--kind", "content: dark, flat, …", default="scene"),
    option("--frames", "stop after this many frames", at_least(1)),
    option("--seconds", "stop after this time (s)", positive),
    option("--exposure", "exposure of a frame, s", within(1e-6, 4000.0), 0.05, dest="exposure_s"),
    option("--rate", "frames per second", within(1e-3, 4000.0), 10.0, dest="frame_rate_hz"),
    option("--step-bias", "code of the DAC for the counters' step, 0 to 4095", at_least(0), 2048),
    option(
        "--rows",
        "rows to read (default: 0 16, all)",
        at_least(0),
        (0, 16),
        nargs=2,
        metavar=("FIRST", "END"),
        dest="row_window",
    ),
    option("--sensor", "preset or YAML file with the counters' nominal step", default="spadcam"),
)
def _capture(options: Namespace) -> str:
    from megalopta.camera import capture
    from megalopta.camera.link import find_port

    sensor, options.row_window = capture.named_sensor(options.sensor), tuple(options.row_window)
    options.sensor = sensor
    out = options.out or Path("recordings") / f"{options.kind}-{datetime.now():%Y%m%d-%H%M%S}"
    stop = stopped_by_signals()

    def find() -> str:
        return options.port or find_port()

    with capture.viewing() as show:
        settings = chosen(options, capture.CaptureSettings)
        recording = capture.capture(find, out, settings, stop, show, wait_s=options.wait)
    return capture.recorded_line(recording)


@verb(
    "spadcam calibrate",
    "write a device file from dark recordings and recordings under uniform light, by name or "
    "from a .yaml list; or from .csv tables of `spadcam tags`",
    *_RECORDINGS,
    out("device.yaml", "device file"),
    option(
        "--preset",
        "preset, or .yaml file of pitch_m, fill_factor, lens …, for what is not measured "
        "(default: spadcam of its recordings, else ideal)",
    ),
)
def _calibrate(options: Namespace) -> Iterator[object]:
    from megalopta.camera import calibration, sources
    from megalopta.camera.measurements import read_measurement

    words, out, preset = options.recordings, options.out, options.preset
    if all(word.endswith(".csv") for word in words):
        paths = [Path(word) for word in words]
        source = f"calibrated from {', '.join(path.name for path in paths)}"
        with refused_as("calibrate"):
            tables = [read_measurement(path) for path in paths]
            yield calibration.write_array_device(out, tables, preset or "ideal", source)
        yield out
        return
    beam = sources.Beam(options.wavelength_nm, options.beam_area_mm2)
    named = sources.named_sources(words, options.format)
    yield calibration.calibrate_recordings(named, out, beam=beam, base=preset)
    yield out
    yield out.with_suffix(".html")


@verb(
    "spadcam compare",
    "compare recordings with the device model's simulation of the same stimulus",
    *_RECORDINGS,
    option("--device", "device file of the model, or a preset", Path, required=True),
    option(
        "--scene",
        "levels: darkness and uniform light; plate: the moving plate, LIGHT is then "
        "its speed in mm/s; or a rendered dataset's folder: LIGHT is then the light level in "
        "lux (without: that of the rendering)",
        default="levels",
    ),
    option("--margin", "relative difference to ignore", positive, 0.05),
    option("--seed", "seed of the simulation", at_least(0), 0),
    out_file("comparison.html", "page"),
)
def _compare(options: Namespace) -> tuple[str, Path]:
    from megalopta.camera.comparison import CompareSettings, compare_captured
    from megalopta.camera.sources import Beam, named_sources

    sources = named_sources(options.recordings, options.format)
    beam = Beam(options.wavelength_nm, options.beam_area_mm2)
    settings = CompareSettings(options.scene, beam, options.margin, options.seed)
    return compare_captured(sources, options.device, options.out, settings), options.out


@verb(
    "spadcam figures",
    "draw the dissertation's figures 2.14 to 2.19 from recordings of the moving plate",
    option(
        "recordings RECORDING@SPEED",
        "folders of recordings (--rate 10 --exposure 0.1), with the plate's speed in mm/s",
        nargs="+",
    ),
    option(
        "--device", "device file to simulate with (default: the recordings' nominal sensor)", Path
    ),
    out("out/plate"),
)
def _figures(options: Namespace) -> Iterator[Path]:
    from megalopta.camera.sources import named_sources
    from megalopta.reproduction.captured_edge import reproduce_captured

    sources = named_sources(options.recordings)
    return reproduce_captured(sources, options.out, options.device)


@verb(
    "spadcam tags",
    "measure rates, afterpulses and crosstalk from time tags in the dark, for spadcam calibrate",
    option("tags", "file of time tags: .ptu, .spc, Photon-HDF5, or LinoSPAD2's .dat", Path),
    option(
        "--linospad2",
        "firmware of the LinoSPAD2 that wrote a .dat file",
        choices=("2212b", "2212s"),
    ),
    option("--per-cycle", "time stamps per cycle and converter of LinoSPAD2", at_least(1), 512),
    option(
        "--columns",
        "columns of the array, whose channels are numbered along rows (default: one row)",
        at_least(1),
    ),
    option("--window-ns", "largest time between coincident events, ns", positive, 25.0),
    out("tags"),
)
def _tags(options: Namespace) -> list[Path]:
    from megalopta.camera.measurements import write_measurements
    from megalopta.sensor.formats.time_tags import read_linospad2, read_time_tags

    with refused_as("spadcam tags"), step("measuring rates, afterpulses and crosstalk"):
        if options.linospad2:
            tags = read_linospad2(options.tags, options.linospad2, options.per_cycle)
        else:
            tags = read_time_tags(options.tags)
        columns = options.columns or tags.channels
        return write_measurements(options.out, tags, columns, 1e-9 * options.window_ns)


@verb(
    "spadcam emulate",
    "emulate the camera on a pseudo-terminal until interrupted; prints the terminal's path",
    option(
        "--stimulus",
        "stimulus: dark, flat, steps, plate, or the folder of a rendered dataset",
        default="flat",
    ),
    option(
        "--photons HZ",
        "photons per second and pixel at 700 nm: one value for flat (default: 5e6), one per "
        "step for steps (default: 0 to 2e7)",
        within(0.0, 1e15),
        nargs="+",
    ),
    option("--step-s", "duration of each step of steps, s", within(1e-3, 1e9), 5.0),
    option("--speed", "speed of the plate, mm/s", within(0.0, 100.0), 5.0),
    option("--lux", "light level of a dataset (lux)", within(0.0, 1e6)),
    option("--sensor", "preset or YAML file", default="spadcam"),
    option("--seed", "seed of photons and noise", at_least(0), 0),
    option("--clock", "speed of the camera's clock, to emulate faster", within(0.1, 100.0), 1.0),
    option("--link", "symbolic link to the terminal", Path),
)
def _emulate(options: Namespace) -> None:
    from megalopta.camera.capture import named_sensor
    from megalopta.camera.emulator import EmulatedCamera, emulate

    camera = EmulatedCamera(named_sensor(options.sensor), _film(options), options.seed)
    dropped = emulate(
        camera,
        stopped_by_signals(),
        options.link,
        lambda path: print(options.link or path, flush=True),
        clock_rate=options.clock,
    )
    say(
        f"emulate: stopped; {dropped} packets were dropped because nothing read them in"
        " time; a capture counts as missing only those between its first and last frame"
    )


def _film(options: Namespace) -> "Film":
    from megalopta.camera.emulator import flat, plate, rendered

    match options.stimulus:
        case "dark":
            return flat
        case "flat":
            if options.photons and len(options.photons) > 1:
                raise UserError("--photons: several values; give one for flat, or --stimulus steps")
            return partial(flat, photons_hz=tuple(options.photons or (5e6,)))
        case "steps":
            levels = options.photons or (0, 1e6, 2e6, 5e6, 1e7, 2e7)
            photons_hz = tuple(map(float, levels))
            return partial(flat, photons_hz=photons_hz, step_s=options.step_s)
        case "plate":
            return partial(plate, speed_mm_s=options.speed)
    folder = Path(options.stimulus)
    if not folder.is_dir():
        raise UserError(
            f"--stimulus: {options.stimulus}; give dark, flat, steps, plate or a dataset's folder"
        )
    return partial(rendered, path=folder, lux=options.lux)
