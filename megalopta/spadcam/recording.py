"""A recording of the camera: what it holds, and how it is opened.

    RECORDING/counts.zarr      counts, saturated, adc, times_s, device_us, sequence_number
    RECORDING/raw.bin          every byte that the camera sent
    RECORDING/recording.yaml   the fields of `RecordingSettings`

`counts.zarr` is a counts store: `megalopta.sensor.open_counts` opens it, too.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from megalopta import strict_yaml
from megalopta.record import Record
from megalopta.sensor import Sensor, StoredFrames, open_counts

COUNTS = "counts.zarr"
RAW = "raw.bin"
SETTINGS = "recording.yaml"


class Connection(Record, frozen=True):
    """A stretch between plugging and unplugging: host time = offset_s + rate · device time."""

    first_frame: int
    """Number, in the recording, of its first frame."""
    raw_offset: int
    """Where its bytes begin in raw.bin."""
    offset_s: float | None = None
    """Host time at device time 0 (s from the recording's start); none: too few frames."""
    rate: float | None = None
    """Host seconds per device second."""
    error_s: float | None = None
    """Mean distance of the earliest arrivals from that line (s)."""


class RecordingSettings(Record, frozen=True):
    """What recording.yaml says."""

    kind: str
    """What was recorded, as told: "dark", "flat", …."""
    started: str
    """UTC at the host, ISO 8601; `times_s` counts from here."""
    finished: bool = False
    """Whether the recording was stopped, not killed."""
    serial_number: str
    """Of the camera."""
    firmware: str
    exposure_s: float
    frame_rate_hz: float
    step_bias: int
    """Code of the DAC that sets the step of the counters."""
    row_window: tuple[int, int]
    """First row that was read, and the one after the last; others hold 0 and are saturated."""
    frames: int = 0
    gaps: int = 0
    """Places where the frame counter skipped or started anew."""
    missing_frames: int = 0
    """Frames that it skipped there, as far as it tells."""
    damaged_packets: int = 0
    connections: tuple[Connection, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """A recording; frames are read when they are sliced.

    Attributes
    ----------
    path : Path
    settings : RecordingSettings
    sensor : Sensor
        The nominal one, through which counts were computed.
    counts, saturated, adc : StoredFrames
        (T, 16, 16): slice them, `recording.counts[:]`.
    times_s : (T,) float64
        When each exposure ended, by the host's clock, s from the start.
    sequence_number : (T,) uint32
        The camera's frame counter.
    """

    path: Path
    settings: RecordingSettings
    sensor: Sensor
    counts: StoredFrames
    saturated: StoredFrames
    adc: StoredFrames
    times_s: NDArray[np.float64]
    sequence_number: NDArray[np.uint32]

    @property
    def kind(self) -> str:
        """What was recorded, as told."""
        return self.settings.kind

    @property
    def exposure_s(self) -> float:
        """How long a frame is exposed, s."""
        return self.settings.exposure_s

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.counts)


def open_recording(path: str | Path) -> Recording:
    """Open a recording, one of a capture that was killed included.

    Raises
    ------
    FileNotFoundError
        When there is nothing of this name.
    ValueError
        When it is no recording, or damaged.
    """
    path = Path(path)
    settings = _settings(path / SETTINGS)
    opened = open_counts(path / COUNTS)
    if not isinstance(opened.sensor, Sensor):
        raise ValueError(f"{path / COUNTS}: of no sensor that counts; give a recording of SPADCAM")
    for name in ("adc", "times_s", "sequence_number"):
        if name not in opened.arrays:
            raise ValueError(f"{opened.path}: lacks {name}; give a recording of SPADCAM")
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


def _settings(path: Path) -> RecordingSettings:
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file; give the folder of a recording")
    try:
        return RecordingSettings.model_validate(strict_yaml.load(path.read_text("utf-8")))
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        place = ".".join(map(str, problem["loc"]))
        raise ValueError(f"{path}: {place}: {problem['msg']}") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
