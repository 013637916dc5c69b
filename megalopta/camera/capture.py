"""Record a camera until stopped, and show the recording."""

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from megalopta.camera import link as links
from megalopta.camera.recording import Recorder, Recording, open_recording
from megalopta.core.errors import UserError, machine_problem, refused_as
from megalopta.core.files import remove
from megalopta.core.folders import locked
from megalopta.core.progress import say, working
from megalopta.sensor import AnalogCounter, Sensor, changed
from megalopta.sensor.formats import protocol
from megalopta.sensor.image_sensors import spad_named

_SHOW_EVERY_S = 0.1
PATIENCE_S = 8.0
"""Longest wait for frames of a connected camera, beyond three frame periods."""


def named_sensor(name: str) -> Sensor:
    """Return a preset, or the sensor of a YAML file. Raises UserError."""
    with refused_as("--sensor"):
        return spad_named(name)


def sensor_as_set(
    sensor: Sensor, settings: protocol.Settings, identity: protocol.Identity | None = None
) -> Sensor:
    """Return a sensor with the camera's exposure, and a step proportional to the bias (assumed).

    ADC and supply are those that the camera reports, if given. Raises UserError if the sensor does
    not allow these values, or its counters have no ADC.
    """
    counter = sensor.counter
    if not isinstance(counter, AnalogCounter) or not counter.adc_bits:
        raise UserError(
            f"sensor {sensor.name}: its counters have no ADC; choose another, such as spadcam"
        )
    fields = {"step_v": counter.step_v * settings.step_bias / protocol.NOMINAL_STEP_BIAS}
    if identity is not None:
        fields |= {"adc_bits": identity.adc_bits, "supply_v": identity.supply_mv * 1e-3}
    with refused_as(f"sensor {sensor.name}"):
        return changed(sensor, exposure_s=settings.exposure_us / 1e6, counter=fields)


@dataclass(frozen=True)
class CaptureSettings:
    """Settings of a recording."""

    sensor: Sensor
    """Nominal sensor, whose step gives the counts."""
    kind: str
    """Kind of recording, such as "dark" or "flat"; stored with it."""
    exposure_s: float
    frame_rate_hz: float
    step_bias: int
    row_window: tuple[int, int]
    """First row that is read, and the row after the last."""
    frames: int | None = None
    """Number of frames; default: until stopped."""
    seconds: float | None = None
    """Duration, from the first frame on."""

    @property
    def of_camera(self) -> protocol.Settings:
        """Settings in the camera's format. Raises UserError if it does not support them."""
        rate_hz = self.frame_rate_hz
        times = round(self.exposure_s * 1e6), round(rate_hz * 1e3)
        settings = protocol.Settings(*times, self.step_bias, *self.row_window)
        if settings.exposure_us > settings.period_us:
            raise UserError(
                f"--exposure: {self.exposure_s:g} s is longer than a frame at --rate {rate_hz:g}; "
                f"lower the rate to {1 / self.exposure_s:g} or less"
            )
        if not settings.are_possible:
            rows = " ".join(map(str, self.row_window))
            raise UserError(
                f"--step-bias {self.step_bias}, --rows {rows}: give a bias of 0 to 4095, and rows "
                "0 <= first < end <= 16"
            )
        return settings


Show = Callable[[Recorder, str], None]
"""Shows the state of a capture: what is recorded, and that in a line."""


def capture(
    find: Callable[[], str], out: Path, settings: CaptureSettings, stop: threading.Event,
    show: Show = lambda recorder, state: None, wait_s: float = 0.0,
) -> Recording:  # fmt: skip
    """Record into a new folder until frames or seconds are complete, or `stop` is set.

    It waits up to `wait_s`, with a message, for a port that does not exist yet. Raises UserError if
    a setting is impossible, the folder exists, or the camera is absent, does not answer, refuses,
    or sends no frames; earlier frames are kept.
    """
    of_camera, recorder = settings.of_camera, None
    if out.exists() or out.is_symlink():
        raise UserError(f"{out}: exists already; choose another --out, or remove it")
    with locked(out):
        try:
            with _linked(find, wait_s, stop) as link:
                identity, start_s = _identity(link), time.monotonic()
                sensor = sensor_as_set(settings.sensor, of_camera, identity)
                valid_us = _configure(link, of_camera)
                recorder = Recorder(out, sensor, settings.kind, identity, of_camera, start_s)
                try:
                    _record(link, recorder, settings, valid_us, stop, show)
                finally:
                    recorder.finish(link.damaged)
        except (OSError, UserError) as problem:
            if recorder is None or not recorder.frames:
                remove(out)
                raise
            reason = str(problem)
            if isinstance(problem, OSError):
                reason = (machine_problem(problem) or reason).partition(";")[0]
            kept = f"the {recorder.frames} earlier frames are kept in {out}"
            raise UserError(f"{reason}; {kept}") from problem
    return open_recording(out)


def _linked(find: Callable[[], str], wait_s: float, stop: threading.Event) -> links.Link:
    end_s, is_noted = time.monotonic() + wait_s, False
    while True:
        try:
            return links.Link(find)
        except links.NoPortError as problem:
            if time.monotonic() >= end_s or stop.is_set():
                raise
            if not is_noted:
                say(f"capture: waiting up to {wait_s:g} s: {problem}")
            is_noted = True
            stop.wait(0.1)


def _identity(link: links.Link) -> protocol.Identity:
    """Ask the camera who it is. Raises UserError if it is no SPADCAM."""
    identity = protocol.Identity.of(link.request(protocol.Kind.IDENTIFY).payload)
    if (identity.rows, identity.columns) != (protocol.ROWS, protocol.COLUMNS):
        raise UserError(
            f"the camera reports {identity.rows} × {identity.columns} pixels, but SPADCAM has "
            "16 × 16; flash this release's firmware"
        )
    return identity


def _configure(link: links.Link, wanted: protocol.Settings) -> int:
    """Configure the camera; return its time when the first exposure ends, µs."""
    kinds = protocol.Kind
    for kind, *values in (
        (kinds.SET_EXPOSURE, 1),  # the shortest, which allows every frame rate
        (kinds.SET_FRAME_RATE, wanted.frame_rate_mhz),
        (kinds.SET_EXPOSURE, wanted.exposure_us),
        (kinds.SET_STEP_BIAS, wanted.step_bias),
        (kinds.SET_ROW_WINDOW, wanted.first_row, wanted.end_row),
    ):
        reply = link.request(*protocol.command(kind, *values))
        if (reported := protocol.Settings.of(reply.payload)).refused:
            raise UserError(
                f"{link.path}: the camera refused {kind.name.lower()}; choose another --exposure, "
                "--rate, --step-bias or --rows"
            )
    if reported != wanted:
        raise UserError(
            f"{link.path}: the camera reports {reported} after it was set to {wanted}; flash this "
            "release's firmware, or unplug it and plug it in again"
        )
    return reply.device_us + wanted.exposure_us


def _record(
    link: links.Link, recorder: Recorder, settings: CaptureSettings, valid_us: float,
    stop: threading.Event, show: Show,
) -> None:  # fmt: skip
    """Record frames as they arrive; after unplugging, configure the camera again."""
    of_camera, serial_number = settings.of_camera, recorder.header.serial_number
    patience_s = PATIENCE_S + 3e-6 * of_camera.period_us
    connection, first_s, shown_s = link.connection, math.inf, 0.0
    frame_s = time.monotonic()
    while not stop.is_set() and recorder.frames != settings.frames:
        arrival, now_s = link.next(_SHOW_EVERY_S), time.monotonic()
        if now_s - first_s >= (settings.seconds or math.inf):
            return
        if arrival is not None and arrival.connection > connection:
            connection, valid_us = link.connection, math.inf
            with suppress(links.LinkLostError):
                if (identity := _identity(link)).serial_number != serial_number:
                    raise UserError(
                        f"{link.path}: camera {identity.serial_number} was plugged in instead of "
                        f"{serial_number}; record it separately"
                    )
                valid_us = _configure(link, of_camera)
                recorder.plugged_again()
                frame_s = time.monotonic()
        elif arrival is not None and arrival.connection == connection:
            packet = arrival.packet
            if packet.kind == protocol.Kind.FRAME and packet.device_us >= valid_us:
                recorder.take(arrival.host_s, packet)
                first_s, frame_s = min(first_s, arrival.host_s), now_s
        if not link.is_plugged:
            frame_s = now_s
        if now_s - frame_s > patience_s:
            raise UserError(
                f"{link.path}: no new frame in {patience_s:.1f} s; unplug the camera and plug it "
                "in again, or choose another --port"
            )
        if recorder.last is not None and now_s - shown_s >= _SHOW_EVERY_S:
            shown_s, rate_hz = now_s, recorder.frames / max(now_s - first_s, 1.0)
            state = (
                f"{recorder.frames} frames, {rate_hz:.1f} frames/s, {recorder.missing_frames} "
                f"missing, {link.damaged} packets damaged"
            )
            show(recorder, state if link.is_plugged else f"{state}, unplugged, waiting")


def recorded_line(recording: Recording) -> str:
    """Return a summary of a recording as one line."""
    settings = recording.settings
    return (
        f"{recording.path}: {len(recording)} frames of {settings.serial_number}, "
        f"{recording.gaps} gaps between first and last ({recording.missing_frames} frames "
        f"missing), {settings.damaged_packets} packets damaged"
    )


@contextmanager
def viewing() -> Iterator[Show]:
    """Yield a display: a picture on a terminal, otherwise a line every ten seconds."""
    if not sys.stderr.isatty():
        last = ["no frames yet"]
        with working("capture", lambda: last[0]):
            yield lambda recorder, state: last.__setitem__(0, state)
        return
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    with Live(console=Console(stderr=True), refresh_per_second=10, transient=True) as live:

        def show(recorder: Recorder, state: str) -> None:
            counts, saturated = recorder.newest
            brightest = max(int(counts.max(initial=1, where=~saturated)), 1)
            grays = np.minimum(255 * np.sqrt(counts / brightest), 255).astype(int)
            pixels = Text()
            for (row, column), gray in np.ndenumerate(grays):
                color = "220,60,40" if saturated[row, column] else f"{gray},{gray},{gray}"
                pixels.append("  ", f"on rgb({color})")
                pixels.append("\n" * (column == protocol.COLUMNS - 1))
            live.update(pixels.append(f"{state}, {saturated.sum()} saturated; Ctrl-C stops"))

        yield show
