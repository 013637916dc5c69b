"""Frames of a link, or of `raw.bin`, written to a recording that can be opened at any moment.

Times are the camera's in the host's clock, from arrival times of frames. The delay of an arrival is
never negative, often small and sometimes large: a USB hub, or the host, was busy. So host time over
device time lies above a straight line and touches it again and again. The estimate is the line
below all arrivals with the smallest mean distance to them, the edge of their lower convex hull at
their mean time: not a regression, which every burst would pull upwards. The hull has O(log n)
corners for n arrivals with random delays, so hours of frames take little memory. The delay of the
fastest frame is unknown: all times are late by it.
"""

import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext, suppress
from datetime import UTC, datetime
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.camera_settings import named_sensor, sensor_as_set
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
from megalopta.core import strict_yaml
from megalopta.core.bounded import check_file
from megalopta.core.errors import UserError, refused_as
from megalopta.core.files import atomic_write, remove, sweep, write_text
from megalopta.core.folders import locked
from megalopta.core.format_numbers import written
from megalopta.core.progress import progress, silent
from megalopta.sensor import AnalogCounter, Sensor, open_counts
from megalopta.sensor.formats.counts_store import ExtraArray, GrowingCounts, Origin
from megalopta.sensor.formats.protocol import (
    COLUMNS,
    NOT_READ,
    ROWS,
    Identity,
    Kind,
    Packet,
    Parser,
    Settings,
    samples_of,
)
from megalopta.sensor.spad.counters import counts_of_codes, nominal_pixels

_LARGEST_DRIFT = 1e-3
"""No quartz is worse; steeper lines are due to few arrivals."""


class ClockFit(NamedTuple):
    """Host time = offset_s + rate · device time."""

    offset_s: float
    """Host time at device time 0, s."""
    rate: float
    """Host seconds per device second."""
    error_s: float | None
    """Mean distance of the hull of arrivals from the line, s; None if unknown."""

    def host_s(self, device_us: int) -> float:
        """Host time, s."""
        return self.offset_s + self.rate * (device_us * 1e-6)


class Clock:
    """Fits one clock to another, arrival by arrival, unless the fit is given."""

    def __init__(self, known: ClockFit | None = None) -> None:
        self._known = known
        self._corners: list[tuple[float, float]] = []
        self._arrivals = 0
        self._mean_s = 0.0

    def arrived(self, device_s: float, host_s: float) -> None:
        """Note an arrival, in order of device times."""
        corners = self._corners
        if corners and device_s <= corners[-1][0]:
            return
        self._arrivals += 1
        self._mean_s += (device_s - self._mean_s) / self._arrivals
        while len(corners) > 1 and _is_above(corners[-1], corners[-2], (device_s, host_s)):
            corners.pop()
        corners.append((device_s, host_s))

    @property
    def fit(self) -> ClockFit | None:
        """Return the line; None before the first arrival."""
        if self._known or not self._corners:
            return self._known
        device_s, host_s = np.array(self._corners).T
        rate, edge = 1.0, int(np.searchsorted(device_s, self._mean_s))
        if edge:  # within the possible rates of a clock
            slope = np.diff(host_s)[edge - 1] / np.diff(device_s)[edge - 1]
            rate = float(np.clip(slope, 1 - _LARGEST_DRIFT, 1 + _LARGEST_DRIFT))
        heights = host_s - rate * device_s
        offset_s = float(heights.min())
        mean = np.average(heights[1:] + heights[:-1], weights=np.diff(device_s)) / 2 if edge else 0
        return ClockFit(offset_s, rate, float(mean) - offset_s if edge else 0.0)


def _is_above(
    middle: tuple[float, float], left: tuple[float, float], right: tuple[float, float]
) -> bool:
    """True if a point lies on or above the line between two others."""
    rise = (middle[1] - left[1]) * (right[0] - left[0])
    return rise >= (right[1] - left[1]) * (middle[0] - left[0])


EXTRAS = {
    "adc": ExtraArray(np.uint16, "codes of the ADC; 65535: not read", of_pixels=True),
    "times_s": ExtraArray(np.float64, "s from the start, by the host's clock"),
    "device_us": ExtraArray(np.uint64, "µs by the camera's clock"),
    "sequence_number": ExtraArray(np.uint32, "the camera's frame counter"),
}
_WRAP = 2**32
_AT_ONCE = _CODES = 65536


class Recorder:
    """Writes a recording into its folder; `write` makes pending frames readable.

    The sensor is the nominal one, with the camera's exposure and step; `start_s` is the host's
    monotonic clock at the start of the recording, s.
    """

    def __init__(
        self,
        folder: Path,
        sensor: Sensor,
        kind: str,
        identity: Identity,
        settings: Settings,
        start_s: float,
    ) -> None:
        self._folder, self._start_s = folder, start_s
        self._of_code = _counts_of_every_code(sensor)
        self.record = RecordingSettings(
            kind=kind,
            started=datetime.now(UTC).isoformat(timespec="milliseconds"),
            serial_number=identity.serial_number,
            firmware=identity.firmware,
            exposure_s=settings.exposure_us / 1e6,
            frame_rate_hz=settings.frame_rate_mhz / 1e3,
            step_bias=settings.step_bias,
            row_window=(settings.first_row, settings.end_row),
        )
        """Content of recording.yaml."""
        origin = Origin(sensor=sensor, seed=0, sequence=kind, extra={"camera": identity._asdict()})
        self._store = GrowingCounts(folder / COUNTS, origin, (ROWS, COLUMNS), EXTRAS)
        self._connections: list[Connection] = []
        self._clock = Clock()
        self._last: int | None = None
        self._taken: list[Packet] = []
        self._publish()

    @property
    def frames(self) -> int:
        """Frames so far."""
        return self._store.frames + len(self._taken)

    def plugged(self, raw_offset: int, clock: Clock | None = None) -> None:
        """Begin a connection: the camera's counter and clock restart.

        It is written to disk at once: raw.bin itself does not mark it.
        """
        self._append()
        self._close_connection()
        gaps = self.record.gaps + bool(self._connections)
        self._connections.append(Connection(first_frame=self.frames, raw_offset=raw_offset))
        self._clock, self._last = clock or Clock(), None
        self._publish(gaps=gaps)

    def note(self, **values: Any) -> None:
        """Change the content of recording.yaml."""
        connections = tuple(self._connections)
        self.record = self.record.model_copy(update={**values, "connections": connections})

    def take(self, host_s: float, packet: Packet) -> None:
        """Take a frame; one that came before is skipped."""
        skipped = 0 if self._last is None else (packet.sequence - self._last - 1) % _WRAP
        if skipped == _WRAP - 1:
            return
        if skipped >= _WRAP // 2:  # the camera restarted
            self.plugged(self._connections[-1].raw_offset)
        elif skipped:
            missing = self.record.missing_frames + skipped
            self.note(gaps=self.record.gaps + 1, missing_frames=missing)
        self._last = packet.sequence
        self._clock.arrived(packet.device_us * 1e-6, host_s - self._start_s)
        self._taken.append(packet)

    def write(self, damaged_packets: int) -> None:
        """Make pending frames readable."""
        self._append()
        self._store.publish()
        self._close_connection()
        self._publish(frames=self._store.frames, damaged_packets=damaged_packets)

    def finish(self, damaged_packets: int) -> None:
        """Write the rest, and all times by the final fit of the clocks."""
        self.write(damaged_packets)
        ends = [each.first_frame for each in self._connections[1:]] + [self._store.frames]
        for connection, end in zip(self._connections, ends, strict=True):
            for first in range(connection.first_frame, end, _AT_ONCE):
                device_us = self._store.read("device_us", first, min(first + _AT_ONCE, end))
                self._store.rewrite("times_s", first, _times_s(device_us, connection))
        self._publish(finished=True)

    def last(self) -> tuple[NDArray[np.uint16], NDArray[np.bool_]] | None:
        """Counts and saturated pixels of the newest frame that is not written yet."""
        return self._counts(samples_of(self._taken[-1])) if self._taken else None

    def _append(self) -> None:
        if not self._taken:
            return
        self._close_connection()
        adc = np.array([samples_of(packet) for packet in self._taken])
        counts, saturated = self._counts(adc)
        device_us = np.array([packet.device_us for packet in self._taken], np.uint64)
        values: dict[str, NDArray[Any]] = {
            "counts": counts,
            "saturated": saturated,
            "adc": adc,
            "times_s": _times_s(device_us, self._connections[-1]),
            "device_us": device_us,
            "sequence_number": np.array([each.sequence for each in self._taken], np.uint32),
        }
        self._taken.clear()
        self._store.append(values)

    def _counts(self, adc: NDArray[np.uint16]) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
        counts, saturated = self._of_code
        return counts[adc], saturated[adc]

    def _close_connection(self) -> None:
        """Record the clocks' fit of the current connection."""
        if self._connections and (fit := self._clock.fit):
            self._connections[-1] = self._connections[-1].model_copy(update=fit._asdict())

    def _publish(self, **values: Any) -> None:
        self.note(**values)
        said = {"format": written("recording"), **self.record.model_dump(mode="json")}
        write_text(self._folder / SETTINGS, strict_yaml.dump(said))


def _counts_of_every_code(sensor: Sensor) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
    """Counts, and mask of lower bounds, by the code of the ADC, (65536,)."""
    counter = sensor.counter
    assert isinstance(counter, AnalogCounter)
    codes = np.arange(_CODES).astype(np.uint16)
    known = nominal_pixels(counter, sensor.exposure_s)
    counts, saturated = counts_of_codes(codes, counter, known)
    counts[NOT_READ], saturated[NOT_READ] = 0, True
    return counts, saturated


def _times_s(device_us: NDArray[np.uint64], connection: Connection) -> NDArray[np.float64]:
    assert connection.offset_s is not None and connection.rate is not None
    return np.asarray(connection.offset_s + connection.rate * (device_us * 1e-6), np.float64)


_LARGEST_BYTES = 2**62
_LONG_BYTES = 50_000_000
"""Size from which reading takes more than two seconds."""
_PIECE_BYTES = 256 * 1024
_WRITE_EVERY = 16384


def recover(
    recording: Path, out: Path | None = None, sensor: str = "spadcam"
) -> tuple[Path, RecordingSettings]:
    """Recover a recording from its `raw.bin`, given by its folder or that file.

    Frames take the same way through the same writer as in a capture. Information that is not in the
    bytes, such as clocks and the places of plugging in, comes from recording.yaml: a capture writes
    it before the first frame, and again whenever the camera is plugged in.

    The output is a new folder, by default the recording's own, whose counts are replaced once the
    new ones are complete. The sensor, a preset or YAML file, is the nominal one if the recording
    has lost its own. Raises UserError, without changes, if there is nothing to recover, or the
    recording is in progress or complete. Returns the folder and its settings.
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
    return out, record


def _in_place(folder: Path, sensor: str) -> tuple[Path, RecordingSettings]:
    sweep(folder)
    before, held = _settings(folder), _frames_held(folder)
    if before.finished and held == before.frames:
        raise UserError(
            f"{folder}: is complete, with {held} frames; give --out to recover raw.bin elsewhere"
        )
    with TemporaryDirectory(prefix=f".part-{uuid4().hex[:12]}-", dir=folder) as name:
        temporary = Path(name)
        record = _written(folder, sensor, temporary)
        if record.frames < held:
            raise UserError(
                f"{folder}: holds {held} frames, raw.bin only {record.frames}; give --out to "
                "recover it elsewhere"
            )
        remove(folder / COUNTS)
        (temporary / COUNTS).rename(folder / COUNTS)
        (temporary / SETTINGS).replace(folder / SETTINGS)
    return folder, record


def _settings(folder: Path) -> RecordingSettings:
    if not (folder / SETTINGS).exists():
        raise UserError(f"{folder}: no {SETTINGS} next to {RAW}; give the folder of a recording")
    with refused_as():
        return read_settings(folder)


def _frames_held(folder: Path) -> int:
    try:
        with silent():
            return len(open_recording(folder))
    except (ValueError, OSError):
        return 0


def _written(folder: Path, sensor: str, out: Path) -> RecordingSettings:
    """Write counts and recording.yaml from the bytes into another folder."""
    raw, before = folder / RAW, _settings(folder)
    size = raw.stat().st_size
    recorder = _recorder(out, before, _nominal(folder, before, sensor))
    noted = {
        each.raw_offset: each
        for each in before.connections or [Connection(first_frame=0, raw_offset=0)]
    }
    damaged, end_s = 0, 0.0
    with _reading(2 * size) as advance:
        for begin, end in pairwise([*noted, size]):
            parser, stretch = Parser(), partial(_packets, raw, begin, end, advance)
            valid_us, last_us = _times_us(stretch(Parser()))
            clock = _clock(noted[begin]) or ClockFit(end_s - valid_us * 1e-6, 1.0, None)
            end_s = max(end_s, clock.host_s(last_us))
            recorder.plugged(begin, Clock(clock))
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
    """Show the progress of reading a file, if it takes long."""
    if size < _LONG_BYTES:
        return nullcontext(lambda _: None)
    return progress("recover", size, "byte")


def _packets(
    raw: Path, begin: int, end: int, advance: Callable[[int], object], parser: Parser
) -> Iterator[Packet]:
    """Yield the packets of a part of a file, until the camera is identified again."""
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
    """Return the earliest end of the first exposure as set, and the last end, µs of the camera."""
    valid_us = last_us = 0
    for packet in packets:
        if packet.kind == Kind.SETTINGS:
            valid_us = packet.device_us + Settings.of(packet.payload).exposure_us
        elif packet.kind == Kind.FRAME:
            last_us = packet.device_us
    return valid_us, last_us


def _clock(connection: Connection) -> ClockFit | None:
    """Return the recorded clock of a connection, if there is one."""
    offset_s, rate = connection.offset_s, connection.rate
    if offset_s is None or rate is None or abs(rate - 1) > _LARGEST_DRIFT * (1 + 1e-9):
        return None
    return ClockFit(offset_s, rate, connection.error_s)


def _nominal(folder: Path, before: RecordingSettings, sensor: str) -> Sensor:
    """Return the nominal sensor of the counts, or the named one with the camera's settings."""
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
