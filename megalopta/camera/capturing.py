"""Record a camera until stopped, and show the recording.

A terminal shows the newest frame, other outputs a line now and then.
"""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.camera_settings import CaptureSettings, sensor_as_identified, sensor_as_set
from megalopta.camera.link import Arrived, Link, LinkLostError, NoPortError, Plugged, Unplugged
from megalopta.camera.recorder import Recorder
from megalopta.camera.recording import Recording, open_recording
from megalopta.core.errors import UserError, machine_problem
from megalopta.core.files import remove
from megalopta.core.folders import locked
from megalopta.core.progress import say, speaking
from megalopta.sensor.formats.protocol import (
    Kind,
    Settings,
    command,
)

_RATE_OVER_S = 1.0
_SHOW_EVERY_S = 0.1
_SWITCHING_S = 0.0002
_LOOK_AGAIN_S = 0.1
_LONGEST_WAIT_S = 604_800.0
PATIENCE_S = 8.0
"""Longest wait for frames of a connected camera, beyond three frame periods."""


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
    frames = 0
    with locked(out), _switching_fast():
        try:
            with _linked(find, wait_s, stop) as link:
                begun = _Capture(link, out, settings, show)
                begun.run(stop)
        except (OSError, UserError) as error:
            problem = error
        try:
            frames = begun.finish() if begun else 0
        except OSError as error:
            frames, problem = begun.recorder.frames if begun and begun.recorder else 0, error
        if not frames and (problem or begun is None or begun.recorder is None):
            remove(out)
    if problem is not None and frames:
        reason = str(problem)
        if isinstance(problem, OSError):
            reason = (machine_problem(problem) or reason).partition(";")[0]
        raise UserError(f"{reason}; the {frames} earlier frames are kept in {out}") from problem
    if problem is not None:
        raise problem
    if begun is None or begun.recorder is None:
        raise UserError(f"{out}: no recording, stopped before the camera answered; try again")
    return open_recording(out)


@contextmanager
def _switching_fast() -> Iterator[None]:
    # The reader releases the GIL several times per 4 KiB, and waits this long for it while a chunk
    # is written: with the default 5 ms, 1000 frames/s are too fast.
    switching_s = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCHING_S)
    try:
        yield
    finally:
        sys.setswitchinterval(switching_s)


def _linked(find: Callable[[], str], wait_s: float, stop: threading.Event) -> Link:
    if not 0 <= wait_s <= _LONGEST_WAIT_S:
        raise UserError(f"--wait: {wait_s:g}; give 0 to {_LONGEST_WAIT_S:g} s")
    end_s, has_told = time.monotonic() + wait_s, False
    while True:
        try:
            return Link(find)
        except NoPortError as problem:
            if time.monotonic() >= end_s or stop.is_set():
                raise
            if not has_told:
                say(f"capture: waiting up to {wait_s:g} s: {problem}")
                has_told = True
            stop.wait(_LOOK_AGAIN_S)


class _Capture:
    def __init__(
        self, link: Link, out: Path, settings: CaptureSettings, show: Callable[[State], None]
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
            self._look_around(now_s)

    def finish(self) -> int:
        """Record what a closed link has read, complete the files, and count frames.

        Raises OSError if they cannot be written.
        """
        if self.recorder is None:
            return 0
        while (event := self._link.read_already()) and not self._is_enough():
            if isinstance(event, Arrived):
                self._take(event)
        self.recorder.finish(self._link.damaged)
        return self.recorder.frames

    def _is_enough(self) -> bool:
        wanted, frames = self._settings, self.recorder.frames if self.recorder else 0
        if wanted.frames is not None and frames >= wanted.frames:
            return True
        if wanted.seconds is None or self._first_s is None:
            return False
        return time.monotonic() - self._first_s >= wanted.seconds

    def _take(self, event: Plugged | Unplugged | Arrived | None) -> None:
        if isinstance(event, Plugged):
            try:
                self._begin()
            except LinkLostError:
                self._is_plugged = False
        elif isinstance(event, Unplugged):
            self._is_plugged = False
        elif event is not None and self.recorder is not None and self._is_plugged:
            packet = event.packet
            if packet.kind == Kind.FRAME and packet.device_us >= self._valid_us:
                before = self.recorder.frames
                self.recorder.take(*event)
                if self.recorder.frames > before:
                    self._be_patient()
                self._first_s = self._first_s or event.host_s

    def _begin(self) -> None:
        identity = self._link.identity()
        settings = self._configure()
        if self.recorder is None:
            sensor = sensor_as_set(sensor_as_identified(self._settings.sensor, identity), settings)
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

    def _configure(self) -> Settings:
        """Configure the camera; frames whose exposure began earlier are skipped."""
        wanted = self._settings.wanted()
        commands = (
            # The shortest exposure allows every frame rate.
            command(Kind.SET_EXPOSURE, 1),
            command(Kind.SET_FRAME_RATE, wanted.frame_rate_mhz),
            command(Kind.SET_EXPOSURE, wanted.exposure_us),
            command(Kind.SET_STEP_BIAS, wanted.step_bias),
            command(Kind.SET_ROW_WINDOW, wanted.first_row, wanted.end_row),
        )
        for kind, payload in commands:
            reply = self._link.request(kind, payload)
            if Settings.of(reply.payload).refused:
                raise UserError(
                    f"{self._link.path}: the camera refused {kind.name.lower()}; choose "
                    "another --exposure, --rate, --step-bias or --rows"
                )
        said = Settings.of(reply.payload)
        for name in wanted._fields:
            asked, claimed = getattr(wanted, name), getattr(said, name)
            if asked != claimed:
                raise UserError(
                    f"{self._link.path}: the camera reports {name} {claimed} after it was set to "
                    f"{asked}; flash this release's firmware, or unplug it and plug it in again"
                )
        self._valid_us = reply.device_us + wanted.exposure_us
        return said

    def _look_around(self, now_s: float) -> None:
        if self.recorder is None:
            return
        if now_s - self._shown_s >= _SHOW_EVERY_S:
            self._shown_s = now_s
            taken, shown = self.recorder, self.recorder.last() or (None, None)
            counted = taken.frames, taken.gaps, taken.missing_frames, self._link.damaged
            self._show(State(*counted, self._rate_hz, self._is_plugged, *shown))
        since_s, frames = self._rate_from
        if now_s - since_s >= _RATE_OVER_S:
            self._rate_hz = (self.recorder.frames - frames) / (now_s - since_s)
            self._rate_from = (now_s, self.recorder.frames)


_SATURATED = "on rgb(220,60,40)"


def status_line(state: State) -> str:
    """Return the state of a capture as one line."""
    parts = [
        f"{state.frames} frames",
        f"{state.rate_hz:.1f} frames/s",
        f"{state.gaps} gaps ({state.missing_frames} frames missing)",
        f"{state.damaged_packets} packets damaged",
    ]
    if state.saturated is not None:
        parts.append(f"{int(state.saturated.sum())} pixels saturated")
    if not state.is_plugged:
        parts.append("unplugged, waiting")
    return ", ".join(parts)


def recorded_line(recording: Recording) -> str:
    """Return a summary of a recording as one line."""
    settings, error_s = recording.settings, recording.times_error_s
    times = f", times to {error_s * 1e3:.2g} ms" if error_s else ""
    if error_s is None:
        times = ", times by the camera's clock alone, which disagrees with this machine's"
    return (
        f"{recording.path}: {len(recording)} frames of {settings.serial_number}, "
        f"{recording.gaps} gaps between first and last ({recording.missing_frames} frames "
        f"missing), {settings.damaged_packets} packets damaged{times}"
    )


@contextmanager
def viewing() -> Iterator[Callable[[State], None]]:
    """Yield a display of states: a picture on a terminal, otherwise a line every ten seconds."""
    if sys.stderr.isatty():
        with _picture() as show:
            yield show
        return
    last: list[State] = []
    with speaking(lambda: f"capture: {status_line(last[0]) if last else 'no frames yet'}"):
        yield lambda state: last.__setitem__(slice(None), [state])


@contextmanager
def _picture() -> Iterator[Callable[[State], None]]:
    from rich.console import Console, Group
    from rich.live import Live
    from rich.text import Text

    blocks = Text("")
    with Live(console=Console(stderr=True), refresh_per_second=10, transient=True) as live:

        def show(state: State) -> None:
            nonlocal blocks
            if state.counts is not None and state.saturated is not None:
                blocks = Text()
                for style in _styles(state.counts, state.saturated):
                    blocks.append("  " if style else "\n", style or None)
            live.update(Group(blocks, Text(status_line(state) + "; Ctrl-C stops")))

        yield show


def _styles(counts: NDArray[np.uint16], saturated: NDArray[np.bool_]) -> Iterator[str]:
    """Yield the background of each pixel, gray by its share of the brightest; "" after each row."""
    brightest = max(int(counts[~saturated].max(initial=1)), 1)
    for row, full in zip(counts, saturated, strict=True):
        for count, is_full in zip(row, full, strict=True):
            gray = min(int(255 * (int(count) / brightest) ** 0.5), 255)
            yield _SATURATED if is_full else f"on rgb({gray},{gray},{gray})"
        yield ""
