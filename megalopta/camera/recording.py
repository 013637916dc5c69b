"""A recording of the camera: written while frames arrive, and opened at any moment.

    RECORDING/recording.yaml   header: the fields of `RecordingSettings`
    RECORDING/frames.bin       a record for each frame, as in `RECORD`, only appended

Times are the camera's. Each connection begins at the host's time of the frame that came fastest,
since the delay of an arrival is never negative and sometimes large.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from megalopta.core import strict_yaml
from megalopta.core.bounded import check_file, printable, read_text
from megalopta.core.errors import UserError, refused_as
from megalopta.core.files import write_text
from megalopta.core.format_numbers import FORMATS, check_format
from megalopta.core.progress import say
from megalopta.core.record import Record
from megalopta.core.validation import checked
from megalopta.sensor import AnalogCounter, Sensor
from megalopta.sensor.formats import protocol
from megalopta.sensor.spad.counters import counts_of_codes, nominal_pixels

FRAMES = "frames.bin"
SETTINGS = "recording.yaml"

RECORD = np.dtype(
    [
        ("connection", "<u4"),
        ("sequence", "<u4"),
        ("device_us", "<u8"),
        ("host_s", "<f8"),
        ("adc", "<u2", (protocol.ROWS, protocol.COLUMNS)),
    ]
)
"""A frame: times that the camera was plugged in before, its frame counter, its clock at the end of
the exposure, the host's clock at arrival (s from the start), and codes of its ADC (65535: not
read)."""

Text = Annotated[str, AfterValidator(printable)]
"""Text of a camera or a foreign file: shown without control codes."""


class RecordingSettings(Record, frozen=True):
    """Fields of recording.yaml."""

    kind: Text
    """Kind of recording, as given: "dark", "flat", …."""
    started: Text
    """UTC at the host, ISO 8601; times count from here."""
    finished: bool = False
    """True if the recording was stopped, not killed."""
    damaged_packets: int = 0
    """Packets refused, if finished."""
    serial_number: Text
    """Serial number of the camera."""
    firmware: Text
    exposure_s: float = Field(gt=0)
    frame_rate_hz: float = Field(gt=0)
    step_bias: int
    """Code of the DAC that sets the step of the counters."""
    row_window: tuple[int, int]
    """First row that was read, and the row after the last; others hold 0 and are saturated."""
    sensor: Sensor
    """Nominal sensor, from which counts are computed."""


@dataclass(frozen=True, eq=False)
class FramesByCode:
    """Frames computed from codes of the ADC when sliced, (T, 16, 16)."""

    adc: NDArray[np.uint16]
    of_code: NDArray[Any]
    """Value of each code, (65536,)."""

    def __getitem__(self, frames: slice | int) -> NDArray[Any]:
        """Return these frames."""
        return np.asarray(self.of_code[self.adc[frames]])


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """A recording; frames are read when sliced: `recording.counts[:]`."""

    path: Path
    settings: RecordingSettings
    counts: FramesByCode
    saturated: FramesByCode
    adc: NDArray[np.uint16]
    """(T, 16, 16): codes of the ADC."""
    times_s: NDArray[np.float64]
    """(T,) float64: end of each exposure, s from the start."""
    sequence_number: NDArray[np.uint32]
    """(T,) uint32: the camera's frame counter."""
    connection: NDArray[np.uint32]
    """(T,) uint32: how often the camera was plugged in before."""
    gaps: int
    """Places where the frame counter skipped or restarted."""
    missing_frames: int
    """Frames skipped there, as far as known."""

    @property
    def kind(self) -> str:
        """Kind of recording, as given."""
        return self.settings.kind

    @property
    def exposure_s(self) -> float:
        """Exposure of a frame, s."""
        return self.settings.exposure_s

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.adc)


def is_recording(path: Path) -> bool:
    """Return True for a recording of SPADCAM, which has codes of its ADC."""
    return (path / FRAMES).exists()


def open_recording(path: str | Path) -> Recording:
    """Open a recording, even one of a killed capture.

    Raises FileNotFoundError if it does not exist; ValueError if it is no recording, or damaged.
    """
    path = Path(path)
    header = path / SETTINGS
    for name in (SETTINGS, FRAMES):
        if (path / name).is_symlink():
            raise UserError(f"{path / name}: a link in a recording; remove it")
    if not header.exists():
        raise FileNotFoundError(f"{header}: no such file; give the folder of a recording")
    with refused_as(str(header)):
        values = strict_yaml.load(read_text(header, 4 * 1024**2))
        if isinstance(values, Mapping):
            check_format("recording", values, header)
            values = {name: value for name, value in values.items() if name != "format"}
        settings = checked(RecordingSettings, values)
    check_file(path / FRAMES, 2**40)
    frames, dropped_bytes = divmod((path / FRAMES).stat().st_size, RECORD.itemsize)
    if not settings.finished or dropped_bytes:
        dropped = f", {dropped_bytes} bytes of an incomplete one are dropped" * bool(dropped_bytes)
        say(f"{path}: not finished; {frames} complete frames{dropped}")
    # an empty file cannot be mapped
    records = (
        np.memmap(path / FRAMES, RECORD, "r", shape=(frames,)) if frames else np.empty(0, RECORD)
    )
    connection, sequence = (np.array(records[name]) for name in ("connection", "sequence"))
    times_s, host_s = records["device_us"] * 1e-6, np.array(records["host_s"])
    if not np.isfinite(host_s).all():
        raise ValueError(f"{path / FRAMES}: times are no finite numbers; restore the file")
    restarts = np.diff(connection.astype(np.int64)) != 0
    for part in np.split(np.arange(frames), np.flatnonzero(restarts) + 1):
        times_s[part] += np.min(host_s[part] - times_s[part], initial=np.inf)
    skipped = (np.diff(sequence) - np.uint32(1))[~restarts]  # modulo 2³², as the counter
    counts, saturated = counts_by_code(settings.sensor)
    return Recording(
        path=path, settings=settings, counts=FramesByCode(records["adc"], counts),
        saturated=FramesByCode(records["adc"], saturated), adc=records["adc"], times_s=times_s,
        sequence_number=sequence, connection=connection,
        gaps=int(restarts.sum() + (skipped > 0).sum()),
        missing_frames=int(skipped.sum(dtype=np.int64)),
    )  # fmt: skip


def counts_by_code(sensor: Sensor) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
    """Counts, and mask of lower bounds, by the code of the ADC, (65536,)."""
    counter = sensor.counter
    if not isinstance(counter, AnalogCounter):
        raise ValueError(f"sensor {sensor.name}: has no analog counters; give one such as spadcam")
    known = nominal_pixels(counter, sensor.exposure_s)
    counts, saturated = counts_of_codes(np.arange(2**16).astype(np.uint16), counter, known)
    counts[protocol.NOT_READ], saturated[protocol.NOT_READ] = 0, True
    return counts, saturated


def write_settings(folder: Path, settings: RecordingSettings) -> None:
    """Write recording.yaml."""
    stated = {"format": FORMATS["recording"].written, **settings.model_dump(mode="json")}
    write_text(folder / SETTINGS, strict_yaml.dump(stated))


class Recorder:
    """Writes the header of a recording, and a record for each frame as it arrives.

    The sensor is the nominal one, with the camera's exposure and step; `start_s` is the host's
    monotonic clock at the start of the recording, s.
    """

    def __init__(
        self, folder: Path, sensor: Sensor, kind: str, identity: protocol.Identity,
        settings: protocol.Settings, start_s: float,
    ) -> None:  # fmt: skip
        self._folder, self._start_s = folder, start_s
        self.header = RecordingSettings(
            kind=printable(kind), started=datetime.now(UTC).isoformat(timespec="milliseconds"),
            serial_number=identity.serial_number, firmware=identity.firmware,
            exposure_s=settings.exposure_us / 1e6, frame_rate_hz=settings.frame_rate_mhz / 1e3,
            step_bias=settings.step_bias, row_window=(settings.first_row, settings.end_row),
            sensor=sensor,
        )  # fmt: skip
        """Content of recording.yaml."""
        self.frames = self.missing_frames = 0
        """Frames so far, and those that the counter skipped."""
        self.last: protocol.Packet | None = None
        """Newest frame of this connection."""
        self._connection = 0
        self._file = (folder / FRAMES).open("xb", buffering=0)
        write_settings(folder, self.header)

    def plugged_again(self) -> None:
        """Begin another connection: the camera's counter and clock restart."""
        self._connection += 1
        self.last = None

    def take(self, host_s: float, packet: protocol.Packet) -> None:
        """Write a frame. Raises OSError without room."""
        if self.last is not None:
            self.missing_frames += (packet.sequence - self.last.sequence - 1) % 2**32
        times = packet.device_us, host_s - self._start_s
        values = self._connection, packet.sequence, *times, protocol.samples_of(packet)
        record = np.array(values, RECORD).tobytes()
        while record:  # a nearly full disk may take only a part
            record = record[self._file.write(record) :]
        self.frames += 1
        self.last = packet

    @property
    def newest(self) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
        """Counts of the newest frame (16, 16), and its pixels whose count is a lower bound."""
        assert self.last is not None
        counts, saturated = counts_by_code(self.header.sensor)
        codes = protocol.samples_of(self.last)
        return counts[codes], saturated[codes]

    def finish(self, damaged_packets: int) -> None:
        """Close the records, and state in the header that they are complete."""
        self._file.close()
        stated = {"finished": True, "damaged_packets": damaged_packets}
        write_settings(self._folder, self.header.model_copy(update=stated))
