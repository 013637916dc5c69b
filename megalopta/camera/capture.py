"""Record a camera until stopped, and show the recording.

A terminal shows the newest frame, other outputs a line now and then.
"""

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.camera import link as links
from megalopta.camera.recording import Recorder, Recording, open_recording
from megalopta.core.bounded import printable, quoted
from megalopta.core.errors import UserError, machine_problem, refused_as
from megalopta.core.files import remove
from megalopta.core.folders import locked
from megalopta.core.progress import say, speaking
from megalopta.sensor import AnalogCounter, Sensor, changed, load_sensor, preset
from megalopta.sensor.formats import protocol

_POSSIBLE = {
    "rows": (protocol.ROWS, protocol.ROWS),
    "columns": (protocol.COLUMNS, protocol.COLUMNS),
    "adc_bits": (1, 16),
    "supply_mv": (1000, 6000),
}
"""Possible values of the camera's identity."""
_MOST_LETTERS = 100
_RATE_OVER_S = 1.0
_SHOW_EVERY_S = 0.1
_SWITCHING_S = 0.0002
_LOOK_AGAIN_S = 0.1
_LONGEST_WAIT_S = 604_800.0
PATIENCE_S = 8.0
"""Longest wait for frames of a connected camera, beyond three frame periods."""


def named_sensor(name: str) -> Sensor:
    """Return a preset, or the sensor of a YAML file. Raises UserError."""
    with refused_as("--sensor"):
        return load_sensor(name) if name.endswith((".yaml", ".yml")) else preset(name)


def sensor_as_set(sensor: Sensor, settings: protocol.Settings) -> Sensor:
    """Return a sensor with the camera's exposure, and a step proportional to the bias (assumed).

    Raises UserError if the sensor does not allow these values, or its counters have no ADC.
    """
    counter = sensor.counter
    if not isinstance(counter, AnalogCounter) or not 0 < (counter.adc_bits or 0) <= 16:
        raise UserError(
            f"sensor {sensor.name}: its counters have no ADC of 1 to 16 bits; "
            "choose another, such as spadcam"
        )
    step_v = counter.step_v * settings.step_bias / protocol.NOMINAL_STEP_BIAS
    with refused_as(f"sensor {sensor.name}"):
        return changed(sensor, exposure_s=settings.exposure_us / 1e6, counter={"step_v": step_v})


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

    def check(self) -> None:
        """Check that the camera supports the settings. Raises UserError."""
        kind = self.kind
        if not 0 < len(kind) <= _MOST_LETTERS or kind != printable(kind) or "/" in kind:
            raise UserError(
                f"--kind: {quoted(kind)!r}; give 1 to {_MOST_LETTERS} letters without a slash"
            )
        for name, limit in (("frames", self.frames), ("seconds", self.seconds)):
            if limit is not None and not 0 < limit < math.inf:
                raise UserError(f"--{name}: {quoted(limit)}; give more than 0, or omit it")
        for name, value, least in (
            ("exposure", self.exposure_s, 1e-6),
            ("rate", self.frame_rate_hz, 1e-3),
        ):
            if not least <= value <= 4000:
                raise UserError(f"--{name}: {value:g}; give a value between {least:g} and 4000")
        wanted = self.wanted()
        if wanted.exposure_us > wanted.period_us:
            raise UserError(
                f"--exposure: {self.exposure_s:g} s is longer than a frame at --rate "
                f"{self.frame_rate_hz:g}; lower the rate to {1 / self.exposure_s:g} or less"
            )
        if not wanted.are_possible:
            first, end = self.row_window
            raise UserError(
                f"--step-bias {self.step_bias}, --rows {first} {end}: give a bias of 0 to "
                "4095, and rows 0 <= first < end <= 16"
            )

    def wanted(self) -> protocol.Settings:
        """Settings in the camera's format."""
        times = round(self.exposure_s * 1e6), round(self.frame_rate_hz * 1e3)
        return protocol.Settings(*times, self.step_bias, *self.row_window)


class State(NamedTuple):
    """State of a capture, for display."""

    frames: int
    gaps: int
    missing_frames: int
    damaged_packets: int
    rate_hz: float
    is_plugged: bool
    counts: NDArray[np.uint16] | None
    saturated: NDArray[np.bool_] | None

    def __str__(self) -> str:
        """Describe it on one line."""
        parts = [
            f"{self.frames} frames",
            f"{self.rate_hz:.1f} frames/s",
            f"{self.gaps} gaps ({self.missing_frames} frames missing)",
            f"{self.damaged_packets} packets damaged",
        ]
        if self.saturated is not None:
            parts.append(f"{int(self.saturated.sum())} pixels saturated")
        if not self.is_plugged:
            parts.append("unplugged, waiting")
        return ", ".join(parts)


def capture(
    find: Callable[[], str],
    out: Path,
    settings: CaptureSettings,
    stop: threading.Event,
    show: Callable[[State], None] = lambda state: None,
    wait_s: float = 0.0,
) -> Recording:
    """Record into a new folder until frames or seconds are complete, or `stop` is set.

    It waits up to `wait_s`, with a message, for a port that does not exist yet. Raises UserError if
    a setting is impossible, the folder exists, or the camera is absent, does not answer, refuses,
    sends no frames, or has not answered when it is stopped; earlier frames are kept.
    """
    settings.check()
    if out.exists() or out.is_symlink():
        raise UserError(f"{out}: exists already; choose another --out, or remove it")
    begun: _Capture | None = None
    problem: OSError | UserError | None = None
    # The reader releases the GIL several times per 4 KiB, and waits this long for it while a chunk
    # is written: with the default 5 ms, 1000 frames/s are too fast.
    switching_s = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCHING_S)
    try:
        with locked(out):
            try:
                with _linked(find, wait_s, stop) as link:
                    begun = _Capture(link, out, settings, show)
                    begun.run(stop)
            except (OSError, UserError) as error:
                problem = error
            try:
                if begun:
                    begun.finish()
            except OSError as error:
                problem = error
            recorder = begun.recorder if begun else None
            if recorder is None or (problem and not recorder.frames):
                remove(out)
    finally:
        sys.setswitchinterval(switching_s)
    if problem is not None and recorder is not None and recorder.frames:
        reason = str(problem)
        if isinstance(problem, OSError):
            reason = (machine_problem(problem) or reason).partition(";")[0]
        kept = f"the {recorder.frames} earlier frames are kept in {out}"
        raise UserError(f"{reason}; {kept}") from problem
    if problem is not None:
        raise problem
    if recorder is None:
        raise UserError(f"{out}: no recording, stopped before the camera answered; try again")
    return open_recording(out)


def _linked(find: Callable[[], str], wait_s: float, stop: threading.Event) -> links.Link:
    if not 0 <= wait_s <= _LONGEST_WAIT_S:
        raise UserError(f"--wait: {wait_s:g}; give 0 to {_LONGEST_WAIT_S:g} s")
    end_s, has_told = time.monotonic() + wait_s, False
    while True:
        try:
            return links.Link(find)
        except links.NoPortError as problem:
            if time.monotonic() >= end_s or stop.is_set():
                raise
            if not has_told:
                say(f"capture: waiting up to {wait_s:g} s: {problem}")
                has_told = True
            stop.wait(_LOOK_AGAIN_S)


class _Capture:
    def __init__(
        self, link: links.Link, out: Path, settings: CaptureSettings, show: Callable[[State], None]
    ) -> None:
        self._link, self._out, self._settings, self._show = link, out, settings, show
        self._start_s = time.monotonic()
        self._first_s: float | None = None
        self._patience_s = PATIENCE_S + 3e-6 * settings.wanted().period_us
        self._frame_s, self._came_before = self._start_s, 0
        self._valid_us = 0
        self._is_plugged = False
        self._shown_s = 0.0
        self._rate_from = (self._start_s, 0)
        self._rate_hz = 0.0
        self.recorder: Recorder | None = None

    def run(self, stop: threading.Event) -> None:
        """Record frames as they arrive."""
        while not stop.is_set() and not self._is_enough():
            self._take(self._link.next(_SHOW_EVERY_S))
            now_s = time.monotonic()
            if self._is_plugged and now_s - self._frame_s > self._patience_s:
                size = self._link.read_bytes - self._came_before
                arrived = f"{size} bytes came" if size else "nothing came"
                raise UserError(
                    f"{self._link.path}: no new frame in {self._patience_s:.1f} s, {arrived} "
                    "instead; unplug the camera and plug it in again, or choose another --port"
                )
            if self.recorder is not None:
                self._show_state(self.recorder, now_s)

    def finish(self) -> None:
        """Record what a closed link has read, and complete the files.

        Raises OSError if they cannot be written.
        """
        if self.recorder is None:
            return
        while (event := self._link.read_already()) and not self._is_enough():
            if isinstance(event, links.Arrived):
                self._take(event)
        self.recorder.finish(self._link.damaged)

    def _is_enough(self) -> bool:
        wanted, frames = self._settings, self.recorder.frames if self.recorder else 0
        if wanted.frames is not None and frames >= wanted.frames:
            return True
        if wanted.seconds is None or self._first_s is None:
            return False
        return time.monotonic() - self._first_s >= wanted.seconds

    def _take(self, event: links.Event | None) -> None:
        if isinstance(event, links.Plugged):
            try:
                self._begin()
            except links.LinkLostError:
                self._is_plugged = False
        elif isinstance(event, links.Unplugged):
            self._is_plugged = False
        elif event is not None and self.recorder is not None and self._is_plugged:
            packet = event.packet
            if packet.kind == protocol.Kind.FRAME and packet.device_us >= self._valid_us:
                before = self.recorder.frames
                self.recorder.take(*event)
                if self.recorder.frames > before:
                    self._be_patient()
                self._first_s = self._first_s or event.host_s

    def _begin(self) -> None:
        """Identify and configure a camera that was plugged in."""
        identity = self._link.identity()
        settings = self._configure()
        if self.recorder is None:
            sensor = sensor_as_set(self._as_identified(identity), settings)
            kind = self._settings.kind
            self.recorder = Recorder(self._out, sensor, kind, identity, settings, self._start_s)
        elif identity.serial_number != self.recorder.header.serial_number:
            raise UserError(
                f"{self._link.path}: camera {identity.serial_number} was plugged in instead of "
                f"{self.recorder.header.serial_number}; record it separately"
            )
        self.recorder.plugged()
        self._is_plugged = True
        self._be_patient()

    def _be_patient(self) -> None:
        self._frame_s, self._came_before = time.monotonic(), self._link.read_bytes

    def _as_identified(self, identity: protocol.Identity) -> Sensor:
        """Nominal sensor with the ADC and supply that the camera reports."""
        for name, (least, most) in _POSSIBLE.items():
            if not least <= (value := getattr(identity, name)) <= most:
                raise UserError(
                    f"the camera reports {name} {value}, but SPADCAM has {least} to {most}; flash "
                    "this release's firmware"
                )
        adc = {"adc_bits": identity.adc_bits, "supply_v": identity.supply_mv * 1e-3}
        sensor = self._settings.sensor
        with refused_as(f"sensor {sensor.name}: does not fit the camera"):
            return changed(sensor, counter=adc)

    def _configure(self) -> protocol.Settings:
        """Configure the camera; frames whose exposure began earlier are skipped."""
        wanted, kinds = self._settings.wanted(), protocol.Kind
        commands: tuple[tuple[protocol.Kind, tuple[int, ...]], ...] = (
            # The shortest exposure allows every frame rate.
            (kinds.SET_EXPOSURE, (1,)),
            (kinds.SET_FRAME_RATE, (wanted.frame_rate_mhz,)),
            (kinds.SET_EXPOSURE, (wanted.exposure_us,)),
            (kinds.SET_STEP_BIAS, (wanted.step_bias,)),
            (kinds.SET_ROW_WINDOW, (wanted.first_row, wanted.end_row)),
        )
        for kind, values in commands:
            reply = self._link.request(*protocol.command(kind, *values))
            said = protocol.Settings.of(reply.payload)
            if said.refused:
                raise UserError(
                    f"{self._link.path}: the camera refused {kind.name.lower()}; choose "
                    "another --exposure, --rate, --step-bias or --rows"
                )
        for name in wanted._fields:
            asked, claimed = getattr(wanted, name), getattr(said, name)
            if asked != claimed:
                raise UserError(
                    f"{self._link.path}: the camera reports {name} {claimed} after it was set to "
                    f"{asked}; flash this release's firmware, or unplug it and plug it in again"
                )
        self._valid_us = reply.device_us + wanted.exposure_us
        return said

    def _show_state(self, taken: Recorder, now_s: float) -> None:
        if now_s - self._shown_s >= _SHOW_EVERY_S:
            self._shown_s = now_s
            counted = taken.frames, taken.gaps, taken.missing_frames, self._link.damaged
            shown = taken.last() or (None, None)
            self._show(State(*counted, self._rate_hz, self._is_plugged, *shown))
        since_s, frames = self._rate_from
        if now_s - since_s >= _RATE_OVER_S:
            self._rate_hz = (taken.frames - frames) / (now_s - since_s)
            self._rate_from = (now_s, taken.frames)


def recorded_line(recording: Recording) -> str:
    """Return a summary of a recording as one line."""
    settings = recording.settings
    return (
        f"{recording.path}: {len(recording)} frames of {settings.serial_number}, "
        f"{recording.gaps} gaps between first and last ({recording.missing_frames} frames "
        f"missing), {settings.damaged_packets} packets damaged"
    )


@contextmanager
def viewing() -> Iterator[Callable[[State], None]]:
    """Yield a display of states: a picture on a terminal, otherwise a line every ten seconds."""
    if not sys.stderr.isatty():
        last: list[State] = []
        with speaking(lambda: f"capture: {last[0] if last else 'no frames yet'}"):
            yield lambda state: last.__setitem__(slice(None), [state])
        return
    from rich.console import Console, Group
    from rich.live import Live
    from rich.text import Text

    pixels = Text("")
    with Live(console=Console(stderr=True), refresh_per_second=10, transient=True) as live:

        def show(state: State) -> None:
            nonlocal pixels
            if state.counts is not None and state.saturated is not None:
                brightest = max(int(state.counts[~state.saturated].max(initial=1)), 1)
                grays = np.minimum(255 * np.sqrt(state.counts / brightest), 255).astype(int)
                pixels = Text()
                for row, full in zip(grays, state.saturated, strict=True):
                    for gray, is_full in zip(row, full, strict=True):
                        color = "220,60,40" if is_full else f"{gray},{gray},{gray}"
                        pixels.append("  ", f"on rgb({color})")
                    pixels.append("\n")
            live.update(Group(pixels, Text(f"{state}; Ctrl-C stops")))

        yield show
