"""The link to a camera: its serial port, and a thread that reads it.

The thread only reads and notes the time, so that neither a slow disk nor a busy user makes it miss
anything. When the camera is unplugged, it waits until it is back.
"""

import errno
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import NamedTuple, Self

import serial
from serial.tools import list_ports

from megalopta.core.bounded import printable
from megalopta.core.errors import UserError
from megalopta.sensor.formats.protocol import Identity, Kind, Packet, Parser, encode

TEENSY_VENDOR = 0x16C0
UDEV_RULE = (
    'SUBSYSTEM=="tty", ATTRS{idVendor}=="16c0", MODE="0660", GROUP="dialout", '
    'ENV{ID_MM_DEVICE_IGNORE}="1"'
)
"""For /etc/udev/rules.d/: lets the group open the port, and keeps ModemManager away."""
_CHOOSE = "choose another port (see megalopta spadcam list)"
_PLUG_IN = f"plug the camera in, start an emulated one (megalopta spadcam emulate), or {_CHOOSE}"
_REMEDIES = {
    errno.ENOENT: f"no such port; {_PLUG_IN}",
    errno.EACCES: (
        "no permission; join its group (sudo usermod -aG dialout $USER, then log in again), or put "
        f"this udev rule into /etc/udev/rules.d/49-spadcam.rules: {UDEV_RULE}"
    ),
    **dict.fromkeys(
        (errno.EBUSY, errno.EAGAIN),
        "another program has it open; close it. To keep ModemManager away: "
        f"sudo systemctl stop ModemManager, or the udev rule {UDEV_RULE}",
    ),
}
_RETRY_S = 0.1
_REPLY_S = 0.7
_REPLIES = Kind.IDENTITY, Kind.SETTINGS
_ASKED = 3
"""Attempts; all commands may be repeated."""
_MOST_WAITING = 8192
"""Most waiting chunks of bytes, a frame or more each. Further ones wait in the camera."""
_GATHER_S = 0.003
_MUCH = 3000
"""Pause after fewer bytes than this, in which further packets gather: at 1000 frames/s waking up
for each would cost more than reading it. A pseudo-terminal holds 4096 bytes; as many waiting mean
that the reader is late."""


class NoPortError(UserError):
    """There is no such port yet."""


def _usb_ports() -> Iterator[tuple[str, bool, str, str]]:
    """Yield path, true for a Teensy, serial number and description of USB serial ports."""
    for port in list_ports.comports():
        if port.vid is not None:
            texts = (printable(text or "") for text in (port.serial_number, port.description))
            yield port.device, port.vid == TEENSY_VENDOR, *texts


def find_port(serial_number: str | None = None) -> str:
    """Path of the camera's port: of a USB serial number, or the only Teensy.

    Raises UserError if there is none (NoPortError), or more than one.
    """
    teensies = {path: number for path, is_teensy, number, _ in _usb_ports() if is_teensy}
    fitting = [path for path, number in teensies.items() if serial_number in (None, number)]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        choice = ", ".join(f"{path} ({teensies[path]})" for path in fitting)
        raise UserError(f"several cameras: {choice}; choose one with --port or --usb-serial")
    who = f"no camera of USB serial number {serial_number}" if serial_number else "no camera"
    raise NoPortError(f"{who} is plugged in; {_PLUG_IN}")


def open_port(path: str) -> serial.Serial:
    """Open a port exclusively.

    Raises UserError if it does not open; NoPortError if there is none.
    """
    try:
        # USB ignores the baud rate.
        return serial.Serial(path, 115200, timeout=0.1, write_timeout=1, exclusive=True)
    except serial.SerialException as problem:
        remedy = _REMEDIES.get(problem.errno or 0, f"no serial port with a device; {_CHOOSE}")
        kind = NoPortError if problem.errno == errno.ENOENT else UserError
        raise kind(f"{path}: {remedy}") from None


def port_lines() -> Iterator[str]:
    """Yield a line per USB serial port: path, serial number, description, whether it opens."""
    for path, is_teensy, number, description in _usb_ports():
        try:
            open_port(path).close()
            state = "free"
        except UserError as problem:
            state = str(problem).partition(": ")[2].partition(";")[0]
        kind = "Teensy" if is_teensy else "other"
        yield f"{path}  {number or '-'}  {kind}  {description}  {state}"


class Plugged(NamedTuple):
    """The camera was plugged in."""


class Unplugged(NamedTuple):
    """The camera was unplugged."""


class Arrived(NamedTuple):
    """A packet, and the time when its last bytes were read, by the host's monotonic clock, s."""

    host_s: float
    packet: Packet


Event = Plugged | Unplugged | Arrived


class LinkLostError(Exception):
    """The camera was unplugged before it answered."""


class Link:
    """An open link; a context manager that closes it.

    `find` returns the path of the port, at first and after unplugging. Raises UserError if the port
    is not found or does not open.
    """

    def __init__(self, find: Callable[[], str]) -> None:
        self._find = find
        self.path = find()
        self._port = open_port(self.path)
        self.read_bytes = 0
        """Bytes that came so far."""
        self._pieces: queue.Queue[Plugged | Unplugged | tuple[float, bytes]] = queue.Queue(
            _MOST_WAITING
        )
        self._seen: deque[Event] = deque()
        self._parser = Parser()
        self._damaged_before = 0
        self._commands = 0
        self._stop = threading.Event()
        self._reader = threading.Thread(target=self._read, name="spadcam reader", daemon=True)
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop reading; `read_already` still returns what was read before."""
        self._stop.set()
        try:
            while self._reader.is_alive() or not self._pieces.empty():
                self._reader.join(0.05)
                while not self._pieces.empty():
                    self._decode(self._pieces.get())
        finally:
            self._port.close()

    @property
    def damaged(self) -> int:
        """Packets refused so far."""
        return self._damaged_before + self._parser.damaged

    def next(self, timeout_s: float) -> Event | None:
        """Return the next event; None if there is none."""
        if not self._seen:
            with suppress(queue.Empty):
                self._decode(self._pieces.get(timeout=timeout_s))
        return self.read_already()

    def read_already(self) -> Event | None:
        """Return the next event that is already decoded; after `close` there are no others."""
        return self._seen.popleft() if self._seen else None

    def request(self, kind: Kind, payload: bytes) -> Packet:
        """Send a command and return the reply; events meanwhile are kept for `next`.

        Raises UserError if there is no reply: the device is not SPADCAM; LinkLostError if the
        camera was unplugged.
        """
        kept = list(self._seen)
        self._seen.clear()
        try:
            for _ in range(_ASKED):
                self._commands += 1
                try:
                    self._port.write(encode(Packet(kind, self._commands, 0, payload)))
                except (OSError, TypeError):  # the reader noticed first and closed the port
                    time.sleep(_RETRY_S)
                end_s = time.monotonic() + _REPLY_S
                while (left_s := end_s - time.monotonic()) > 0:
                    event = self.next(left_s)
                    if event is None:
                        continue
                    if isinstance(event, Arrived):
                        packet = event.packet
                        if packet.kind in _REPLIES and packet.sequence == self._commands:
                            return packet
                    kept.append(event)
                    if isinstance(event, Unplugged):
                        raise LinkLostError
            raise UserError(f"{self.path}: {self._silence()}")
        finally:
            self._seen.extendleft(reversed(kept))

    def identity(self) -> Identity:
        """Return the camera's identity; errors as `request`."""
        return Identity.of(self.request(Kind.IDENTIFY, b"").payload)

    def _silence(self) -> str:
        if self._parser.other_version is not None:
            version = self._parser.other_version
            return f"speaks version {version} of the protocol, not 1; flash this release's firmware"
        what = "does not speak SPADCAM's protocol" if self.read_bytes else "is silent"
        return f"{what}; unplug it and plug it in again, flash its firmware, or {_CHOOSE}"

    def _decode(self, piece: Plugged | Unplugged | tuple[float, bytes]) -> None:
        if isinstance(piece, Plugged | Unplugged):
            # A partial packet from before does not belong to the new bytes.
            self._damaged_before += self._parser.damaged
            self._parser = Parser()
            self._seen.append(piece)
            return
        host_s, data = piece
        self._seen.extend(Arrived(host_s, packet) for packet in self._parser.feed(data))

    def _read(self) -> None:
        """Read until stopped; after unplugging, look for the port until it is back."""
        while not self._stop.is_set():
            self._pieces.put(Plugged())
            with suppress(OSError, TypeError):  # the port disappeared during a read
                while not self._stop.is_set():
                    first = b"" if self._port.in_waiting else bytes(self._port.read(1))
                    data = first + bytes(self._port.read(self._port.in_waiting))
                    if data:
                        self._pieces.put((time.monotonic(), data))
                        self.read_bytes += len(data)
                    if data.endswith(b"\0") and len(data) < _MUCH:
                        time.sleep(_GATHER_S)
            if self._stop.is_set():
                return
            self._port.close()
            self._pieces.put(Unplugged())
            while not self._stop.wait(_RETRY_S):
                with suppress(UserError):
                    self.path = self._find()
                    self._port = open_port(self.path)
                    break
