"""`raw.bin` read back into a recording, after a capture that was killed or had no room.

Frames go the same way through the same writer as those of a capture. What the bytes do not say,
such as clocks and where the camera was plugged in, recording.yaml does: a capture writes it before
the first frame, and again whenever the camera is plugged in.
"""

import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple
from uuid import uuid4

from megalopta.camera.camera_settings import named_sensor, sensor_as_set
from megalopta.camera.recorder import LARGEST_DRIFT, ClockFit, KnownClock, Recorder
from megalopta.camera.recording import (
    COUNTS,
    RAW,
    SETTINGS,
    Connection,
    RecordingSettings,
    check_folder,
    open_recording,
    read_settings,
)
from megalopta.core.bounded import check_file
from megalopta.core.errors import UserError
from megalopta.core.files import atomic_write, remove, sweep
from megalopta.core.folders import locked
from megalopta.core.progress import progress, silent
from megalopta.sensor import AnalogCounter, Sensor, open_counts
from megalopta.sensor.formats.protocol import (
    COLUMNS,
    ROWS,
    Identity,
    Kind,
    Packet,
    Parser,
    Settings,
)

_LARGEST_BYTES = 2**62
_LONG_BYTES = 50_000_000
"""What takes more than some two seconds."""
_PIECE_BYTES = 256 * 1024
_WRITE_EVERY = 16384
_PLUGGED_FIRST = Connection(first_frame=0, raw_offset=0)


class Recovered(NamedTuple):
    """A recording that was read back: where, and what it says."""

    path: Path
    record: RecordingSettings


def recover(recording: Path, out: Path | None = None, sensor: str = "spadcam") -> Recovered:
    """Read the `raw.bin` of a recording back, which is given by its folder or by that file.

    It is read into a new folder, by default into the recording's own, whose counts are replaced
    once the new ones are whole. The sensor is a preset or YAML file of the nominal one, where the
    recording has lost it. Raises UserError when there is nothing to read back, it is being
    recorded, or it is whole; nothing is changed then.
    """
    folder = recording.parent if recording.name == RAW else recording
    check_folder(folder)
    check_file(folder / RAW, _LARGEST_BYTES)
    if out is None:
        with locked(folder):
            return _in_place(folder, sensor)
    if out.exists() or out.is_symlink():
        raise UserError(f"{out}: exists already; choose another --out, or remove it")
    with atomic_write(out) as temporary:
        temporary.mkdir()
        record = _written(folder, sensor, temporary)
        shutil.copyfile(folder / RAW, temporary / RAW)
    return Recovered(out, record)


def _in_place(folder: Path, sensor: str) -> Recovered:
    sweep(folder)
    before, held = _settings(folder), _frames_held(folder)
    if before.finished and held == before.frames:
        raise UserError(
            f"{folder}: is whole, with {held} frames; give --out to read raw.bin back elsewhere"
        )
    with TemporaryDirectory(prefix=f".part-{uuid4().hex[:12]}-", dir=folder) as name:
        temporary = Path(name)
        record = _written(folder, sensor, temporary)
        if record.frames < held:
            raise UserError(
                f"{folder}: holds {held} frames, raw.bin only {record.frames}; give --out to read "
                "it back elsewhere"
            )
        remove(folder / COUNTS)
        (temporary / COUNTS).rename(folder / COUNTS)
        (temporary / SETTINGS).replace(folder / SETTINGS)
    return Recovered(folder, record)


def _settings(folder: Path) -> RecordingSettings:
    if not (folder / SETTINGS).exists():
        raise UserError(f"{folder}: no {SETTINGS} beside {RAW}; give the folder of a recording")
    try:
        return read_settings(folder)
    except ValueError as problem:
        raise UserError(str(problem)) from None


def _frames_held(folder: Path) -> int:
    try:
        with silent():
            return len(open_recording(folder))
    except (ValueError, OSError):
        return 0


def _written(folder: Path, sensor: str, out: Path) -> RecordingSettings:
    """Write counts and recording.yaml of the bytes into another folder."""
    raw, before = folder / RAW, _settings(folder)
    size = raw.stat().st_size
    recorder = _recorder(out, before, _nominal(folder, before, sensor))
    noted = {each.raw_offset: each for each in before.connections or [_PLUGGED_FIRST]}
    damaged, end_s = 0, 0.0
    with _reading(2 * size) as advance:
        for begin, end in pairwise([*noted, size]):
            parser, stretch = Parser(), partial(_packets, raw, begin, end, advance)
            valid_us, last_us = _times_us(stretch(Parser()))
            clock = _clock(noted[begin]) or ClockFit(end_s - valid_us * 1e-6, 1.0, None)
            end_s = max(end_s, clock.host_s(last_us))
            recorder.plugged(begin, KnownClock(clock))
            for number, packet in enumerate(stretch(parser), 1):
                if packet.kind == Kind.FRAME and packet.device_us >= valid_us:
                    recorder.take(clock.host_s(packet.device_us), packet)
                if number % _WRITE_EVERY == 0:
                    recorder.write(0)
            damaged += parser.damaged
    if not recorder.frames:
        raise UserError(f"{raw}: no frame of SPADCAM in its {size} bytes; nothing to recover")
    recorder.finish(damaged)
    return recorder.record


def _reading(size: int) -> AbstractContextManager[Callable[[int], object]]:
    """Show how far a file is read, where that takes long."""
    if size < _LONG_BYTES:
        return nullcontext(lambda _: None)
    return progress("recover", size, "byte")


def _packets(
    raw: Path, begin: int, end: int, advance: Callable[[int], object], parser: Parser
) -> Iterator[Packet]:
    """Yield the packets of a part of a file, until the camera is asked anew who it is."""
    is_set = False
    with raw.open("rb") as file:
        file.seek(begin)
        for at in range(begin, end, _PIECE_BYTES):
            data = file.read(min(_PIECE_BYTES, end - at))
            for packet in parser.feed(data):
                is_set = is_set or packet.kind == Kind.SETTINGS
                if is_set and packet.kind == Kind.IDENTITY:
                    return
                yield packet
            advance(len(data))


def _times_us(packets: Iterable[Packet]) -> tuple[int, int]:
    """Return when the first exposure as set may end, and the last one ends, µs of the camera."""
    valid_us = last_us = 0
    for packet in packets:
        if packet.kind == Kind.SETTINGS:
            valid_us = packet.device_us + Settings.of(packet.payload).exposure_us
        elif packet.kind == Kind.FRAME:
            last_us = packet.device_us
    return valid_us, last_us


def _clock(connection: Connection) -> ClockFit | None:
    """Return the clock that was noted of a connection, where it is one."""
    offset_s, rate = connection.offset_s, connection.rate
    if offset_s is None or rate is None or abs(rate - 1) > LARGEST_DRIFT * (1 + 1e-9):
        return None
    return ClockFit(offset_s, rate, connection.error_s)


def _nominal(folder: Path, before: RecordingSettings, sensor: str) -> Sensor:
    """Return the nominal sensor of the counts, or the named one as the camera was set."""
    with suppress(ValueError, OSError):
        opened = open_counts(folder / COUNTS)
        if isinstance(opened.sensor, Sensor):
            return opened.sensor
    return sensor_as_set(named_sensor(sensor), _as_set(before))


def _as_set(before: RecordingSettings) -> Settings:
    exposure_us, rate_mhz = round(before.exposure_s * 1e6), round(before.frame_rate_hz * 1e3)
    return Settings(exposure_us, rate_mhz, before.step_bias, *before.row_window)


def _recorder(folder: Path, before: RecordingSettings, sensor: Sensor) -> Recorder:
    counter = sensor.counter
    assert isinstance(counter, AnalogCounter)
    supply_mv, bits = round(counter.supply_v * 1e3), counter.adc_bits or 0
    camera = Identity(ROWS, COLUMNS, bits, supply_mv, before.serial_number, before.firmware)
    recorder = Recorder(folder, sensor, before.kind, camera, _as_set(before), 0.0)
    recorder.note(started=before.started, recovered=True)
    return recorder
