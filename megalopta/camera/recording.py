"""A recording of the camera, or of another one: content, name, and opening.

    RECORDING/recording.yaml   header: the fields of `RecordingSettings`
    RECORDING/frames.bin       a record for each frame, as in `RECORD`

Records are only appended, so a recording opens at any moment, even after its capture was killed;
an incomplete one at the end is dropped and counted.

On the command line a recording is named RECORDING or RECORDING@LIGHT; another camera's file of
counts (`megalopta.sensor.formats`) is FILE@LIGHT:EXPOSURE_S. A range of frames, for a recording of
several lights, is RECORDING#0-100@LIGHT.

Times are the camera's in the host's clock, from arrival times of frames. The delay of an arrival is
never negative, often small and sometimes large: a USB hub, or the host, was busy. So host time over
device time lies above a straight line and touches it again and again. The line goes through the
earliest arrivals of a few equal parts of the connection. The delay of the fastest frame is unknown:
all times are late by it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.bounded import check_file, printable, quoted, read_text
from megalopta.core.errors import UserError, refused_as
from megalopta.core.files import write_text
from megalopta.core.format_numbers import check_format, written
from megalopta.core.progress import say
from megalopta.core.record import Record
from megalopta.core.validation import checked
from megalopta.sensor import AnalogCounter, Sensor
from megalopta.sensor.formats.protocol import COLUMNS, NOT_READ, ROWS
from megalopta.sensor.formats.reading import FrameKind, read_frames
from megalopta.sensor.spad.counters import counts_of_codes, nominal_pixels

FRAMES = "frames.bin"
SETTINGS = "recording.yaml"
_SETTINGS_BYTES = 4 * 1024**2
_MOST_LETTERS = 100
_LARGEST_BYTES = 2**40
_LARGEST_DRIFT = 1e-3
"""No quartz is worse."""
_CLOCK_PARTS = 16

RECORD = np.dtype(
    [
        ("connection", "<u4"),
        ("sequence", "<u4"),
        ("device_us", "<u8"),
        ("host_s", "<f8"),
        ("adc", "<u2", (ROWS, COLUMNS)),
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

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.adc)

    @property
    def shape(self) -> tuple[int, ...]:
        """Frames, rows, columns."""
        return self.adc.shape

    def __getitem__(self, frames: slice | int) -> NDArray[Any]:
        """Return these frames."""
        return np.asarray(self.of_code[self.adc[frames]])


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """A recording; frames are read when sliced."""

    path: Path
    settings: RecordingSettings
    counts: FramesByCode
    saturated: FramesByCode
    adc: NDArray[np.uint16]
    """(T, 16, 16); slice it: `recording.counts[:]`."""
    times_s: NDArray[np.float64]
    """(T,) float64: end of each exposure, by the host's clock, s from the start."""
    times_error_s: float | None
    """Mean delay of the earliest arrivals beyond the fastest, s; None: times are the camera's."""
    sequence_number: NDArray[np.uint32]
    """(T,) uint32: the camera's frame counter."""
    connection: NDArray[np.uint32]
    """(T,) uint32: how often the camera was plugged in before."""
    gaps: int
    """Places where the frame counter skipped or restarted."""
    missing_frames: int
    """Frames skipped there, as far as known."""
    dropped_bytes: int
    """Bytes of an incomplete record at the end."""

    @property
    def sensor(self) -> Sensor:
        """Nominal sensor, from which counts were computed."""
        return self.settings.sensor

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


def open_recording(path: str | Path) -> Recording:
    """Open a recording, even one of a killed capture.

    Raises FileNotFoundError if it does not exist; ValueError if it is no recording, or damaged.
    """
    path = Path(path)
    for name in (SETTINGS, FRAMES):
        if (path / name).is_symlink():
            raise UserError(f"{path / name}: a link in a recording; remove it")
    settings = _read_settings(path)
    check_file(path / FRAMES, _LARGEST_BYTES)
    frames, dropped_bytes = divmod((path / FRAMES).stat().st_size, RECORD.itemsize)
    if not settings.finished or dropped_bytes:
        rest = f", {dropped_bytes} bytes of an incomplete one are dropped" if dropped_bytes else ""
        say(f"{path}: not finished; {frames} complete frames{rest}")
    # an empty file cannot be mapped
    records = (
        np.memmap(path / FRAMES, RECORD, "r", shape=(frames,)) if frames else np.empty(0, RECORD)
    )
    times_s, errors_s = np.empty(frames), [0.0]
    connection, sequence = (np.array(records[name]) for name in ("connection", "sequence"))
    restarts = np.diff(connection.astype(np.int64)) != 0
    for part in np.split(np.arange(frames), np.flatnonzero(restarts) + 1):
        device_s, host_s = records["device_us"][part] * 1e-6, records["host_s"][part]
        if not np.isfinite(host_s).all():
            raise ValueError(f"{path / FRAMES}: times are no finite numbers; restore the file")
        times_s[part], error_s = host_times(device_s, host_s)
        errors_s.append(np.nan if error_s is None else error_s)
    skipped = (np.diff(sequence) - np.uint32(1))[~restarts]  # modulo 2³², as the counter
    counts, saturated = counts_by_code(settings.sensor)
    return Recording(
        path=path,
        settings=settings,
        counts=FramesByCode(records["adc"], counts),
        saturated=FramesByCode(records["adc"], saturated),
        adc=records["adc"],
        times_s=times_s,
        times_error_s=None if np.isnan(errors_s).any() else max(errors_s),
        sequence_number=sequence,
        connection=connection,
        gaps=int(restarts.sum() + (skipped > 0).sum()),
        missing_frames=int(skipped.sum(dtype=np.int64)),
        dropped_bytes=dropped_bytes,
    )


def host_times(device_s: Floats, host_s: Floats) -> tuple[Floats, float | None]:
    """Return times of the camera's clock by the host's, and their error if it is known, s.

    A connection's arrivals are cut into equal parts. The line goes through the earliest of each
    part, and is lowered until none is before it.
    """
    delay_s = host_s - device_s
    if device_s.size == 0:
        return delay_s, 0.0
    parts = np.array_split(np.arange(delay_s.size), min(delay_s.size, _CLOCK_PARTS))
    earliest = np.array([part[np.argmin(delay_s[part])] for part in parts])
    drift = 0.0
    if earliest.size > 1 and np.ptp(device_s[earliest]) > 0:
        drift = float(np.polyfit(device_s[earliest], delay_s[earliest], 1)[0])
    is_possible = abs(drift) <= _LARGEST_DRIFT
    late_s = delay_s - (drift if is_possible else 0.0) * device_s
    times_s = host_s - (late_s - late_s.min())
    return times_s, float((late_s[earliest] - late_s.min()).mean()) if is_possible else None


def counts_by_code(sensor: Sensor) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
    """Counts, and mask of lower bounds, by the code of the ADC, (65536,)."""
    counter = sensor.counter
    if not isinstance(counter, AnalogCounter):
        raise ValueError(f"sensor {sensor.name}: has no analog counters; give one such as spadcam")
    known = nominal_pixels(counter, sensor.exposure_s)
    counts, saturated = counts_of_codes(np.arange(2**16).astype(np.uint16), counter, known)
    counts[NOT_READ], saturated[NOT_READ] = 0, True
    return counts, saturated


def check_kind(kind: str) -> None:
    """Refuse an invalid name of a stimulus. Raises UserError."""
    if not 0 < len(kind) <= _MOST_LETTERS or kind != printable(kind) or "/" in kind:
        raise UserError(
            f"--kind: {quoted(kind)!r}; give 1 to {_MOST_LETTERS} letters without a slash"
        )


def write_settings(folder: Path, settings: RecordingSettings) -> None:
    """Write recording.yaml."""
    stated = {"format": written("recording"), **settings.model_dump(mode="json")}
    write_text(folder / SETTINGS, strict_yaml.dump(stated))


def _read_settings(folder: Path) -> RecordingSettings:
    path = folder / SETTINGS
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file; give the folder of a recording")
    try:
        values = strict_yaml.load(read_text(path, _SETTINGS_BYTES))
        if isinstance(values, Mapping):
            check_format("recording", values, path)
            values = {name: value for name, value in values.items() if name != "format"}
        return checked(RecordingSettings, values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


_PLANCK_TIMES_C = 1.98644586e-25


@dataclass(frozen=True)
class Source:
    """A recording and its light."""

    path: Path
    light: float = 0.0
    """As given: photons per second and pixel, or watts of the beam; 0: dark."""
    exposure_s: float | None = None
    frames: tuple[int, int] | None = None
    """First frame, and the frame after the last; none: all."""
    kind: FrameKind | None = None
    """Format of another camera's file; none: by its content, counts or bits of .npy by their type.
    """
    sums: int | None = None
    """Binary frames that each frame of the file is the sum of; none: frames are as recorded."""

    @classmethod
    def parse(cls, text: str, kind: FrameKind | None = None) -> "Source":
        """Parse RECORDING, RECORDING@LIGHT or RECORDING#FIRST-END@LIGHT:EXPOSURE_S.

        Raises UserError if light or exposure is not a number, or negative, or a range of frames is
        invalid.
        """
        name, at, numbers = text.partition("@")
        if not at and ":" in Path(name).name and not Path(name).exists():
            raise UserError(f"{text!r}: give RECORDING@LIGHT:EXPOSURE_S, in the dark @0:EXPOSURE_S")
        path, _, range_ = name.partition("#")
        light, _, exposure = numbers.partition(":")
        try:
            values = float(light or 0), float(exposure) if exposure else None
        except ValueError:
            raise UserError(f"{text!r}: give RECORDING@LIGHT, with a number after the @") from None
        if not 0 <= values[0] < np.inf or (values[1] is not None and not 0 < values[1] < np.inf):
            raise UserError(f"{text!r}: invalid light or exposure; give positive numbers")
        return cls(Path(path), *values, _range(range_, text), kind)


def _range(text: str, source: str) -> tuple[int, int] | None:
    if not text:
        return None
    first, _, end = text.partition("-")
    if not (first.isdecimal() and end.isdecimal() and int(first) < int(end)):
        raise UserError(f"{source!r}: give RECORDING#FIRST-END, such as #0-100 for 100 frames")
    return int(first), int(end)


@dataclass(frozen=True)
class Beam:
    """Light of flat frames, if it is known as a beam's power."""

    wavelength_nm: float | None = None
    area_mm2: float | None = None
    """None: light is given as photons per second and pixel."""

    def photons_hz(self, light: float, sensor: Sensor) -> float:
        """Photons per second and pixel; relative if the wavelength is unknown.

        Raises ValueError if the sensor's curve has no efficiency at the wavelength.
        """
        self._check(sensor)
        if self.area_mm2 is None or self.wavelength_nm is None:
            return light
        photons_hz = light * self.wavelength_nm * 1e-9 / _PLANCK_TIMES_C
        return photons_hz * sensor.pitch_m**2 / (self.area_mm2 * 1e-6)

    def _check(self, sensor: Sensor) -> None:
        curve, nm = sensor.efficiency, self.wavelength_nm
        first, last = curve.wavelengths_nm[0], curve.wavelengths_nm[-1]
        if nm is not None and not (first <= nm <= last and curve(np.array(nm)) > 0):
            raise ValueError(
                f"--wavelength-nm {nm:g}: sensor {sensor.name!r} has no efficiency there, only "
                f"within {first:g} to {last:g} nm; give the wavelength of the light"
            )


@dataclass(frozen=True, eq=False)
class RecordingFrames:
    """Frames of a recording."""

    counts: NDArray[Any]
    """(n, rows, columns)"""
    codes: NDArray[Any] | None
    """Codes of the ADC, if recorded."""
    exposure_s: float
    sensor: Sensor | None
    """Nominal sensor."""
    times_s: Floats
    """Start of each exposure; consecutive if not recorded."""
    is_binary: bool = False
    """True if counts are bits."""

    def at(self, frames: tuple[int, int] | None) -> "RecordingFrames":
        """Keep a range of the frames. Raises ValueError if there are fewer."""
        if frames is None:
            return self
        if frames[1] > len(self.counts):
            raise ValueError(f"frames {frames[0]} to {frames[1] - 1}; it has {len(self.counts)}")
        part = slice(*frames)
        codes = None if self.codes is None else self.codes[part]
        return replace(self, counts=self.counts[part], codes=codes, times_s=self.times_s[part])


def is_recording(path: Path) -> bool:
    """Return True for a recording of SPADCAM, which has codes of its ADC."""
    return any((path / name).exists() for name in (SETTINGS, FRAMES))


def read_recorded(source: Source) -> RecordingFrames:
    """Read a recording.

    Raises UserError if there is none, it is damaged, or its exposure is unknown.
    """
    with refused_as("", OSError):
        recorded = _captured(source) if is_recording(source.path) else _of_others(source)
    with refused_as(f"{source.path}"):
        return recorded.at(source.frames)


def _captured(source: Source) -> RecordingFrames:
    recording = open_recording(source.path)
    times_s = recording.times_s - recording.exposure_s
    return RecordingFrames(
        recording.counts[:], recording.adc, recording.exposure_s, recording.sensor, times_s
    )


def _of_others(source: Source) -> RecordingFrames:
    frames = read_frames(source.path, source.kind)
    exposure = source.exposure_s or frames.exposure_s
    if exposure is None:
        raise ValueError(
            f"{source.path}: exposure is unknown; give {source.path}@LIGHT:SECONDS, or in a list "
            "exposure_s"
        )
    if frames.counts.ndim != 3:
        raise ValueError(f"{source.path}: {frames.counts.ndim} dimensions; give gray frames")
    times_s = exposure * np.arange(len(frames.counts), dtype=np.float64)
    return RecordingFrames(frames.counts, None, exposure, None, times_s, frames.bit_depth == 1)
