"""The emulated camera on a pseudo-terminal: as a device on a USB port, or worse."""

import os
import pty
import select
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from megalopta.camera.emulated import EmulatedCamera
from megalopta.core.errors import UserError
from megalopta.sensor import generator
from megalopta.sensor.formats.protocol import (
    Kind,
    Packet,
    Parser,
    encode,
)

BUFFER_BYTES = 24576 + 65536
"""Room for what waits to be read, in the firmware and in the host's driver, which for a USB port
has 64 KiB and for a pseudo-terminal a sixth of it; a frame that finds none is dropped."""

_LONGEST_WAIT_S = 0.05
_A_DAY_S = 86400.0
_LIMITS = {"noise": (0.0, 1.0), "lost": (0.0, 1.0), "drift_ppm": (-9e5, 1e8)}
_TIMES = (1e-3, _A_DAY_S)
"""Of all other faults, s, where they are not 0."""


@dataclass(frozen=True)
class Faults:
    """Faults of the line.

    Attributes
    ----------
    noise, lost : float
        Probability of each byte to have a bit flipped, or not to arrive.
    burst_s : float
        Bytes are held back and come at once, this often, s.
    drift_ppm : float
        How much too fast the camera's clock goes, 1e-6.
    stall_every_s, stall_s : float
        How often the camera stops sending, and for how long, s.
    unplug_every_s, unplug_s : float
        How long it is plugged in, and for how long it then is not, s.
    """

    noise: float = 0.0
    lost: float = 0.0
    burst_s: float = 0.0
    drift_ppm: float = 0.0
    stall_every_s: float = 0.0
    stall_s: float = 0.0
    unplug_every_s: float = 0.0
    unplug_s: float = 0.5

    def check(self) -> None:
        """Make sure that a line can be so. Raises UserError."""
        for name, value in vars(self).items():
            least, most = _LIMITS.get(name, _TIMES)
            if value != 0 and not least <= value <= most:
                raise UserError(
                    f"--{name.replace('_', '-')}: {value:g}; give 0, or {least:g} to {most:g}"
                )
        if self.stall_every_s and self.stall_s >= self.stall_every_s:
            raise UserError(
                f"--stall-s: {self.stall_s:g}; give less than --stall-every-s, "
                f"{self.stall_every_s:g}"
            )

    def on(self, line: bytes, seed: int, packet: Packet) -> bytes:
        """Return the bytes of a packet that arrive."""
        if not self.noise and not self.lost:
            return line
        rng = generator(seed, "line", packet.kind, packet.sequence)
        data = np.frombuffer(line, np.uint8)
        flips = np.uint8(1) << rng.integers(0, 8, data.size, np.uint8)
        noisy = np.where(rng.random(data.size) < self.noise, data ^ flips, data)
        return noisy[rng.random(data.size) >= self.lost].tobytes()


class EmulatedPort:
    """A pseudo-terminal with an emulated camera behind it.

    Parameters
    ----------
    camera : EmulatedCamera
    faults : Faults
    link : Path, optional
        Where a symbolic link shall lead to the terminal, whose own name may change when the camera
        is unplugged and plugged in again.
    plugged_in : callable, optional
        Told the terminal's path, each time.
    sent : callable, optional
        Told the bytes that left the camera.
    """

    def __init__(
        self,
        camera: EmulatedCamera,
        faults: Faults | None = None,
        link: Path | None = None,
        plugged_in: Callable[[str], None] = lambda path: None,
        sent: Callable[[bytes], None] = lambda data: None,
    ) -> None:
        if link is not None and link.exists() and not link.is_symlink():
            raise UserError(f"{link}: exists and is no symbolic link; choose another name")
        if faults is not None:
            faults.check()
        self._camera, self._faults, self._link = camera, faults or Faults(), link
        self._plugged_in, self._sent = plugged_in, sent
        self.dropped = 0
        """Packets that found no room, until it was last unplugged."""

    def run(self, stop: threading.Event) -> None:
        """Serve until told to stop, plugged in and out as the faults say."""
        while not stop.is_set():
            self._serve(stop)
            if not stop.wait(self._faults.unplug_s):
                self._camera.restart()

    def _serve(self, stop: threading.Event) -> None:
        """Be plugged in once."""
        # As long as somebody has the other end open, writing to this one does not fail.
        end, other_end = pty.openpty()
        try:
            tty.setraw(other_end)
            os.set_blocking(end, False)
            path = os.ttyname(other_end)
            if self._link is not None:
                _point(self._link, path)
            self._plugged_in(path)
            line = _Line(self._camera, self._faults, end, self._sent)
            line.serve(stop)
            self.dropped += line.dropped
        finally:
            if self._link is not None:
                self._link.unlink(missing_ok=True)
            os.close(end)
            os.close(other_end)


class _Line:
    """The line while the camera is plugged in."""

    def __init__(
        self, camera: EmulatedCamera, faults: Faults, end: int, sent: Callable[[bytes], None]
    ) -> None:
        self._camera, self._faults, self._end, self._sent = camera, faults, end, sent
        self._parser = Parser()
        self._waiting = bytearray()
        self._start_s = time.monotonic()
        self.dropped = 0

    def serve(self, stop: threading.Event) -> None:
        """Send frames when they are due, and answer, until stopped or unplugged."""
        life_s = self._faults.unplug_every_s or float("inf")
        while not stop.is_set() and self._elapsed_s() < life_s:
            self._expose()
            to_write = [self._end] if self._waiting and self._may_send() else []
            can_read, can_write, _ = select.select([self._end], to_write, [], self._pause_s())
            if can_read:
                self._receive()
            if can_write:
                self._send()

    def _elapsed_s(self) -> float:
        return time.monotonic() - self._start_s

    def _now_us(self) -> int:
        return int(self._elapsed_s() * (1e6 + self._faults.drift_ppm))

    def _expose(self) -> None:
        if self._camera.due_us <= self._now_us():
            self._post(self._camera.next_frame())

    def _post(self, packet: Packet) -> None:
        """Put a packet among those to be sent, if there is room."""
        line = encode(packet)
        if len(self._waiting) + len(line) <= BUFFER_BYTES:
            self._waiting += self._faults.on(line, self._camera.seed, packet)
        else:
            self.dropped += 1

    def _may_send(self) -> bool:
        faults, now_s = self._faults, self._elapsed_s()
        sending_s = faults.stall_every_s - faults.stall_s
        if faults.stall_every_s and now_s % faults.stall_every_s > sending_s:
            return False
        return not faults.burst_s or now_s % faults.burst_s < 0.2 * faults.burst_s

    def _pause_s(self) -> float:
        """Until the next frame, or until bytes held back may go."""
        due_s = (self._camera.due_us - self._now_us()) * 1e-6
        held = bool(self._waiting) and not self._may_send()
        return min(max(due_s, 0.0), 2e-3 if held else _LONGEST_WAIT_S)

    def _receive(self) -> None:
        for command in self._parser.feed(os.read(self._end, 4096)):
            if command.kind >= Kind.IDENTIFY:
                self._post(self._camera.answer(command, self._now_us()))

    def _send(self) -> None:
        count = os.write(self._end, self._waiting)
        self._sent(bytes(self._waiting[:count]))
        del self._waiting[:count]


def _point(link: Path, path: str) -> None:
    link.parent.mkdir(parents=True, exist_ok=True)
    link.unlink(missing_ok=True)
    link.symlink_to(path)
