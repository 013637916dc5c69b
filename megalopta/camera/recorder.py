"""Frames of a link, written to a recording that can be opened at any moment."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.recording import (
    FRAMES,
    RECORD,
    RecordingSettings,
    counts_by_code,
    write_settings,
)
from megalopta.sensor import Sensor
from megalopta.sensor.formats.protocol import Identity, Packet, Settings, samples_of

_WRAP = 2**32


class Recorder:
    """Writes the header of a recording, and a record for each frame as it arrives.

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
        self._of_code = counts_by_code(sensor)
        self.header = RecordingSettings(
            kind=kind,
            started=datetime.now(UTC).isoformat(timespec="milliseconds"),
            serial_number=identity.serial_number,
            firmware=identity.firmware,
            exposure_s=settings.exposure_us / 1e6,
            frame_rate_hz=settings.frame_rate_mhz / 1e3,
            step_bias=settings.step_bias,
            row_window=(settings.first_row, settings.end_row),
            sensor=sensor,
        )
        """Content of recording.yaml."""
        self.frames = self.gaps = self.missing_frames = 0
        """So far: frames, places where the counter skipped or restarted, and frames skipped."""
        self._connection = -1
        self._last: Packet | None = None
        self._file = (folder / FRAMES).open("xb", buffering=0)
        write_settings(folder, self.header)

    def plugged(self) -> None:
        """Begin a connection: the camera's counter and clock restart."""
        self._connection += 1
        self.gaps += self._connection > 0
        self._last = None

    def take(self, host_s: float, packet: Packet) -> None:
        """Write a frame; one that came before is skipped. Raises OSError without room."""
        if self._last is not None:
            skipped = (packet.sequence - self._last.sequence - 1) % _WRAP
            if skipped == _WRAP - 1:
                return
            if skipped >= _WRAP // 2:  # the camera restarted
                self.plugged()
            else:
                self.gaps += skipped > 0
                self.missing_frames += skipped
        times = packet.device_us, host_s - self._start_s
        values = self._connection, packet.sequence, *times, samples_of(packet)
        record = np.array(values, RECORD).tobytes()
        while record:  # a nearly full disk may take only a part
            record = record[self._file.write(record) :]
        self.frames += 1
        self._last = packet

    def finish(self, damaged_packets: int) -> None:
        """Close the records, and state in the header that they are complete."""
        self._file.close()
        stated = {"finished": True, "damaged_packets": damaged_packets}
        write_settings(self._folder, self.header.model_copy(update=stated))

    def last(self) -> tuple[NDArray[np.uint16], NDArray[np.bool_]] | None:
        """Counts and saturated pixels of the newest frame."""
        if self._last is None:
            return None
        counts, saturated = self._of_code
        adc = samples_of(self._last)
        return counts[adc], saturated[adc]
