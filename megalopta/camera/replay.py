"""Frames of raw.bin through the writer of a capture, with what is known beside them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from megalopta.camera.camera_settings import (
    CaptureSettings,
    named_sensor,
    sensor_as_identified,
    sensor_as_set,
)
from megalopta.camera.clock import LARGEST_DRIFT, ClockFit, KnownClock
from megalopta.camera.recorder import Recorder
from megalopta.camera.recording import Connection, RecordingSettings
from megalopta.camera.survey import (
    Stretch,
    Survey,
    packets_of,
    survey_file,
)
from megalopta.core.errors import UserError
from megalopta.sensor import AnalogCounter, Sensor
from megalopta.sensor.formats.protocol import (
    COLUMNS,
    NOMINAL_STEP_BIAS,
    ROWS,
    Identity,
    Kind,
    Parser,
    Settings,
)

_WRITE_EVERY = 16384
_UNKNOWN = "unknown"
_NOMINAL = "spadcam"


@dataclass(frozen=True)
class Told:
    """Statements of the user about a recording; None: those of the files hold.

    Attributes
    ----------
    kind : str or None
    exposure_s, frame_rate_hz : float or None
    sensor : str or None
        Preset or YAML file of the nominal one.
    """

    kind: str | None = None
    exposure_s: float | None = None
    frame_rate_hz: float | None = None
    sensor: str | None = None


class RawSource(NamedTuple):
    """A file of bytes, and what was written beside it."""

    raw: Path
    before: RecordingSettings | None = None
    sensor: Sensor | None = None
    """The nominal one, as set."""


@dataclass
class Replay:
    """Writes a recording of a source; `unknown` names what nobody knows of it."""

    source: RawSource
    told: Told
    read: Callable[[int], None]
    unknown: list[str] = field(default_factory=list)

    def write(self, folder: Path) -> RecordingSettings:
        """Write counts and recording.yaml into a folder.

        Raises
        ------
        UserError
            When there are no frames, or their settings are not known.
        """
        fits = self._fits()
        found = survey_file(self.source.raw, list(fits), self.read)
        settings = found.set_ones[0].settings if found.set_ones else self._settings(found)
        assert settings is not None
        stretches = self._recorded(found)
        recorder = self._recorder(folder, found, settings)
        end_s = 0.0
        for stretch in stretches:
            clock = fits.get(stretch.begin) or _from(end_s, stretch)
            end_s = max(end_s, clock.host_s(stretch.last_us or 0))
            self._take(stretch, recorder, clock)
        if not recorder.frames:
            raise UserError(f"{self.source.raw}: no frame with these settings; nothing to recover")
        recorder.finish(found.damaged)
        if any(each.begin not in fits for each in stretches):
            self.unknown.append("the host's clock (times are the camera's)")
        return recorder.record

    def _recorded(self, found: Survey) -> Sequence[Stretch]:
        """Return where a capture takes frames; of one that was stopped, no more than it noted."""
        before, stretches = self.source.before, found.set_ones or found.stretches
        if before is None or not before.finished:
            return stretches
        noted = {each.raw_offset for each in before.connections}
        return [each for each in stretches if each.begin in noted] or stretches

    def _fits(self) -> dict[int, ClockFit | None]:
        """Clocks of the connections that were noted, by where they begin."""
        before = self.source.before
        return {each.raw_offset: _fit(each) for each in before.connections} if before else {}

    def _settings(self, found: Survey) -> Settings:
        """Return the settings of a camera that does not report them."""
        told, before, raw = self.told, self.source.before, self.source.raw
        if not (frames := sum(each.frames for each in found.stretches)):
            size = raw.stat().st_size
            raise UserError(f"{raw}: no frame of SPADCAM in its {size} bytes; give another file")
        self.unknown.append("the camera's own settings")
        if told.exposure_s is not None and told.frame_rate_hz is not None:
            kind, rows = told.kind or _UNKNOWN, (0, ROWS)
            bias, sensor = NOMINAL_STEP_BIAS, self._nominal()
            wanted = (told.exposure_s, told.frame_rate_hz, bias, rows)
            as_told = CaptureSettings(sensor, kind, *wanted)
            as_told.check()
            return as_told.wanted()
        if before is None:
            raise UserError(
                f"{raw}: {frames} frames, but no reply that says how the camera was set; give "
                "--exposure and --rate"
            )
        exposure_us, rate_mhz = round(before.exposure_s * 1e6), round(before.frame_rate_hz * 1e3)
        return Settings(exposure_us, rate_mhz, before.step_bias, *before.row_window)

    def _nominal(self) -> Sensor:
        return named_sensor(self.told.sensor or _NOMINAL)

    def _recorder(self, folder: Path, found: Survey, settings: Settings) -> Recorder:
        before = self.source.before
        identity = next((each.identity for each in found.stretches if each.identity), None)
        sensor = self._sensor(identity, settings)
        kind = self.told.kind or (before.kind if before else _UNKNOWN)
        if kind == _UNKNOWN:
            self.unknown.append("its kind (--kind)")
        identity = identity or self._identity(sensor)
        recorder = Recorder(folder, sensor, kind, identity, settings, 0.0)
        recorder.note(started=before.started if before else _UNKNOWN, recovered=True)
        return recorder

    def _sensor(self, identity: Identity | None, settings: Settings) -> Sensor:
        kept = self.source.sensor
        if kept is not None and self.told.sensor is None:
            return kept
        nominal = self._nominal()
        if identity is not None:
            nominal = sensor_as_identified(nominal, identity)
        return sensor_as_set(nominal, settings)

    def _identity(self, sensor: Sensor) -> Identity:
        """Return the identity of a camera that does not report it."""
        before, counter = self.source.before, sensor.counter
        assert isinstance(counter, AnalogCounter)
        supply_mv, bits = round(counter.supply_v * 1e3), counter.adc_bits or 0
        if before is not None:
            return Identity(ROWS, COLUMNS, bits, supply_mv, before.serial_number, before.firmware)
        self.unknown.append("the camera")
        return Identity(ROWS, COLUMNS, bits, supply_mv, _UNKNOWN, _UNKNOWN)

    def _take(self, stretch: Stretch, recorder: Recorder, clock: ClockFit) -> None:
        recorder.plugged(stretch.begin, KnownClock(clock))
        packets = packets_of(self.source.raw, stretch.begin, stretch.end, Parser(), self.read)
        for number, (_, packet) in enumerate(packets, 1):
            if packet.kind == Kind.FRAME and packet.device_us >= stretch.valid_us:
                recorder.take(clock.host_s(packet.device_us), packet)
            if number % _WRITE_EVERY == 0:
                recorder.write(0)


def _fit(connection: Connection) -> ClockFit | None:
    """The clock of a connection, where it is one."""
    offset_s, rate = connection.offset_s, connection.rate
    if offset_s is None or rate is None or abs(rate - 1) > LARGEST_DRIFT * (1 + 1e-9):
        return None
    return ClockFit(offset_s, rate, connection.error_s)


def _from(end_s: float, stretch: Stretch) -> ClockFit:
    """The camera's clock, as if it had been plugged in again at once."""
    return ClockFit(end_s - (stretch.first_us or 0) * 1e-6, 1.0, None)
