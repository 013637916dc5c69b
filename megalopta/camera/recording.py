"""A recording of the camera, or of another one: content, name, and opening.

    RECORDING/counts.zarr      counts, saturated, adc, times_s, device_us, sequence_number
    RECORDING/raw.bin          every byte that the camera sent
    RECORDING/recording.yaml   the fields of `RecordingSettings`

`counts.zarr` is a counts store: `megalopta.sensor.open_counts` opens it, too. On the command line
it is named RECORDING or RECORDING@LIGHT; another camera's file of counts
(`megalopta.sensor.formats`) is FILE@LIGHT:EXPOSURE_S. A range of frames, for a recording of
several lights, is RECORDING#0-100@LIGHT.
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
from megalopta.core.bounded import printable, quoted, read_text
from megalopta.core.errors import UserError, refused_as, shell_command
from megalopta.core.format_numbers import check_format
from megalopta.core.progress import say
from megalopta.core.record import Record
from megalopta.core.validation import checked
from megalopta.sensor import Sensor, StoredFrames, open_counts
from megalopta.sensor.formats.protocol import COLUMNS, ROWS
from megalopta.sensor.formats.reading import FrameKind, read_frames

COUNTS = "counts.zarr"
RAW = "raw.bin"
SETTINGS = "recording.yaml"
_SETTINGS_BYTES = 4 * 1024**2
_MOST_CHUNK_FRAMES = 65536
_MOST_LETTERS = 100

Text = Annotated[str, AfterValidator(printable)]
"""Text of a camera or a foreign file: shown without control codes."""


_SHAPES: Mapping[str, tuple[int, ...]] = {
    **dict.fromkeys(("counts", "saturated", "adc"), (ROWS, COLUMNS)),
    **dict.fromkeys(("times_s", "device_us", "sequence_number"), ()),
}
"""Arrays of a recording, and the shape of a frame in them."""


class Connection(Record, frozen=True):
    """A connection, from plugging to unplugging: host time = offset_s + rate · device time."""

    first_frame: int
    """Number of its first frame in the recording."""
    raw_offset: int
    """Offset of its bytes in raw.bin."""
    offset_s: float | None = None
    """Host time at device time 0 (s from the recording's start); none: too few frames."""
    rate: float | None = None
    """Host seconds per device second."""
    error_s: float | None = None
    """Mean distance of the earliest arrivals from that line (s)."""


class RecordingSettings(Record, frozen=True):
    """Fields of recording.yaml."""

    kind: Text
    """Kind of recording, as given: "dark", "flat", …."""
    started: Text
    """UTC at the host, ISO 8601; `times_s` counts from here."""
    finished: bool = False
    """True if the recording was stopped, not killed."""
    recovered: bool = False
    """True if it was recovered from raw.bin, which has no times of the host's clock."""
    serial_number: Text
    """Serial number of the camera."""
    firmware: Text
    exposure_s: float = Field(gt=0)
    frame_rate_hz: float = Field(gt=0)
    step_bias: int
    """Code of the DAC that sets the step of the counters."""
    row_window: tuple[int, int]
    """First row that was read, and the row after the last; others hold 0 and are saturated."""
    frames: int = 0
    gaps: int = 0
    """Places where the frame counter skipped or restarted."""
    missing_frames: int = 0
    """Frames skipped there, as far as known."""
    damaged_packets: int = 0
    connections: tuple[Connection, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """A recording; frames are read when sliced."""

    path: Path
    settings: RecordingSettings
    sensor: Sensor
    """Nominal sensor, from which counts were computed."""
    counts: StoredFrames
    saturated: StoredFrames
    adc: StoredFrames
    """(T, 16, 16); slice it: `recording.counts[:]`."""
    times_s: NDArray[np.float64]
    """(T,) float64: end of each exposure, by the host's clock, s from the start."""
    sequence_number: NDArray[np.uint32]
    """(T,) uint32: the camera's frame counter."""

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
        return len(self.counts)


def open_recording(path: str | Path) -> Recording:
    """Open a recording, even one of a killed capture.

    Raises FileNotFoundError if it does not exist; ValueError if it is no recording, or damaged.
    """
    path = Path(path)
    check_folder(path)
    settings = read_settings(path)
    if not settings.finished and (path / RAW).exists():
        say(
            f"{path}: not finished; if its capture was killed, recover frames that are only in "
            f"raw.bin: {recover_command(path)}"
        )
    try:
        return _opened(path, settings)
    except (ValueError, FileNotFoundError) as problem:
        if (path / RAW).exists():
            raise ValueError(f"{problem}, or recover raw.bin: {recover_command(path)}") from problem
        raise


def check_folder(path: Path) -> None:
    """Refuse a folder with content that no recording has. Raises UserError."""
    for each in path.rglob("*"):
        if each.is_symlink() or not (each.is_file() or each.is_dir()):
            raise UserError(f"{each}: a link, device or pipe in a recording; remove it")


def check_kind(kind: str) -> None:
    """Refuse an invalid name of a stimulus. Raises UserError."""
    if not 0 < len(kind) <= _MOST_LETTERS or kind != printable(kind) or "/" in kind:
        raise UserError(
            f"--kind: {quoted(kind)!r}; give 1 to {_MOST_LETTERS} letters without a slash"
        )


def recover_command(path: Path) -> str:
    """Return the command that recovers raw.bin."""
    return shell_command("spadcam", "recover", path)


def read_settings(folder: Path) -> RecordingSettings:
    """Read recording.yaml.

    Raises FileNotFoundError if it does not exist; ValueError or UserError if it is damaged, or
    newer than this program.
    """
    path = folder / SETTINGS
    if not path.exists():
        remedy = "give the folder of a recording"
        if (folder / RAW).exists():
            remedy = f"recover raw.bin: {recover_command(folder)}"
        raise FileNotFoundError(f"{path}: no such file; {remedy}")
    try:
        values = strict_yaml.load(read_text(path, _SETTINGS_BYTES))
        if isinstance(values, Mapping):
            check_format("recording", values, path)
            values = {name: value for name, value in values.items() if name != "format"}
        return checked(RecordingSettings, values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _opened(path: Path, settings: RecordingSettings) -> Recording:
    opened = open_counts(path / COUNTS)
    if not isinstance(opened.sensor, Sensor):
        raise ValueError(f"{path / COUNTS}: not of a counting sensor; give a recording of SPADCAM")
    frames = len(opened["counts"])
    for name, shape in _SHAPES.items():
        if name not in opened.arrays:
            raise ValueError(f"{opened.path}: lacks {name}; give a recording of SPADCAM")
        _check_array(opened.path / name, opened[name], (frames, *shape))
    return Recording(
        path=path,
        settings=settings,
        sensor=opened.sensor,
        counts=opened["counts"],
        saturated=opened["saturated"],
        adc=opened["adc"],
        times_s=opened["times_s"][:],
        sequence_number=opened["sequence_number"][:],
    )


def _check_array(path: Path, frames: StoredFrames, shape: tuple[int, ...]) -> None:
    """Refuse an array that a capture does not write, before it is read."""
    at_once = frames.array.chunks[0]
    if frames.shape != shape or at_once > _MOST_CHUNK_FRAMES:
        found = f"is {frames.shape} in chunks of {at_once} frames, not {shape}"
        raise ValueError(f"{path}: {quoted(found)}; give a recording of SPADCAM")
    chunks = sum(each.is_file() for each in (path / "c").rglob("*"))
    if chunks < -(-shape[0] // at_once):
        raise ValueError(f"{path}: chunks are missing; restore them")


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
    return any((path / each).exists() for each in (COUNTS, RAW))


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
    codes = np.asarray(recording.adc[:])
    times_s = recording.times_s - recording.exposure_s
    return RecordingFrames(
        recording.counts[:], codes, recording.exposure_s, recording.sensor, times_s
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
