"""The link to a camera: its serial port, and a thread that reads it, also after unplugging."""

import errno
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, NamedTuple, Self

from megalopta.core.bounded import printable
from megalopta.core.errors import UserError
from megalopta.sensor.formats import protocol

TEENSY_VENDOR = 0x16C0
_CHOOSE = "choose another port (see megalopta spadcam list)"
_PLUG_IN = f"plug the camera in, start an emulated one (megalopta spadcam emulate), or {_CHOOSE}"
_BUSY = (
    "another program has it open; close it. To keep ModemManager away: sudo systemctl stop "
    "ModemManager, or the udev rule in docs/reference/spadcam-protocol.md"
)
_REMEDIES = {
    errno.ENOENT: f"no such port; {_PLUG_IN}",
    errno.EACCES: "no permission; join its group (sudo usermod -aG dialout $USER, log in again)",
    **dict.fromkeys((errno.EBUSY, errno.EAGAIN), _BUSY),
}
_SWITCHING_S = 0.0002
"""The reader releases the GIL several times per 4 KiB, and waits this long for it while a record is
written: with the default of 5 ms, 1000 frames/s are too fast."""
_REPLY_S, _ATTEMPTS = 0.7, 3
_REPLIES = protocol.Kind.IDENTITY, protocol.Kind.SETTINGS
_GATHER_S, _MUCH = 0.003, 3000
"""Pause after fewer bytes than this, in which further packets gather: at 1000 frames/s waking up
for each would cost more than reading it. A pseudo-terminal holds 4096 bytes."""


class NoPortError(UserError):
    """There is no such port yet."""


class LinkLostError(UserError):
    """The camera was unplugged before it answered."""


def _usb_ports() -> Iterator[tuple[str, bool, str, str]]:
    """Yield path, true for a Teensy, serial number and description of USB serial ports."""
    from serial.tools import list_ports  # part of an extra

    for port in list_ports.comports():
        if port.vid is not None:
            texts = (printable(text or "") for text in (port.serial_number, port.description))
            yield port.device, port.vid == TEENSY_VENDOR, *texts


def find_port() -> str:
    """Path of the only Teensy. Raises NoPortError without any, UserError for more than one."""
    cameras = {path: number for path, is_teensy, number, _ in _usb_ports() if is_teensy}
    if not cameras:
        raise NoPortError(f"no camera is plugged in; {_PLUG_IN}")
    if len(cameras) > 1:
        choice = ", ".join(f"{path} ({number})" for path, number in cameras.items())
        raise UserError(f"several cameras: {choice}; choose one with --port")
    return next(iter(cameras))


def open_port(path: str) -> Any:
    """Open a port exclusively. Raises UserError if it does not open; NoPortError without it."""
    import serial

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
        state = "free"
        try:
            open_port(path).close()
        except UserError as problem:
            state = str(problem).partition(": ")[2].partition(";")[0]
        kind = "Teensy" if is_teensy else "other"
        yield f"{path}  {number or '-'}  {kind}  {description}  {state}"


class Arrival(NamedTuple):
    """A packet, as it arrived."""

    connection: int
    """How often the camera was plugged in before."""
    host_s: float
    """Host's monotonic clock when its last bytes were read, s."""
    packet: protocol.Packet


class Link:
    """An open link; a context manager that closes it.

    `find` returns the path of the port, at first and after unplugging. Raises UserError if the port
    is not found or does not open.
    """

    def __init__(self, find: Callable[[], str]) -> None:
        self._find = find
        self.path = find()
        self._port = open_port(self.path)
        self.connection, self.is_plugged = 0, True
        self._arrivals: queue.SimpleQueue[Arrival] = queue.SimpleQueue()
        self._parser = protocol.Parser()
        self._commands = self._read_bytes = 0
        self._stop = threading.Event()
        self._reader = threading.Thread(target=self._read, name="spadcam reader", daemon=True)
        self._reader.start()

    def __enter__(self) -> Self:
        self._switching_s = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCHING_S)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setswitchinterval(self._switching_s)
        self._stop.set()
        self._reader.join()
        self._port.close()

    @property
    def damaged(self) -> int:
        """Packets refused so far."""
        return self._parser.damaged

    def next(self, timeout_s: float) -> Arrival | None:
        """Return the next packet; None if none arrives in time."""
        with suppress(queue.Empty):
            return self._arrivals.get(timeout=timeout_s)
        return None

    def request(self, kind: protocol.Kind, payload: bytes = b"") -> protocol.Packet:
        """Send a command and return the reply; frames meanwhile are of earlier settings, and lost.

        Raises UserError if there is no reply: the device is not SPADCAM; LinkLostError if the
        camera was unplugged.
        """
        connection = self.connection
        for _ in range(_ATTEMPTS):
            self._commands += 1
            with suppress(OSError, TypeError):  # the reader noticed first and closed the port
                self._port.write(protocol.encode(protocol.Packet(kind, self._commands, 0, payload)))
            end_s = time.monotonic() + _REPLY_S
            while (left_s := end_s - time.monotonic()) > 0:
                arrival = self.next(left_s)
                if not self.is_plugged or self.connection != connection:
                    raise LinkLostError(
                        f"{self.path}: unplugged before it answered; plug it in and start again"
                    )
                is_reply = arrival and arrival.packet.kind in _REPLIES
                if arrival and is_reply and arrival.packet.sequence == self._commands:
                    return arrival.packet
        fault = "does not speak SPADCAM's protocol" if self._read_bytes else "is silent"
        if (version := self._parser.other_version) is not None:
            fault = f"speaks version {version} of the protocol, not {protocol.VERSION}"
        raise UserError(
            f"{self.path}: {fault}; unplug it and plug it in again, flash this release's firmware, "
            f"or {_CHOOSE}"
        )

    def _read(self) -> None:
        """Read until stopped; after unplugging, look for the port until it is back."""
        while True:
            with suppress(OSError, TypeError):  # the port disappeared during a read
                while not self._stop.is_set():
                    data = bytes(self._port.read(1))
                    data += bytes(self._port.read(self._port.in_waiting))
                    self._read_bytes += len(data)
                    host_s = time.monotonic()
                    for packet in self._parser.feed(data):
                        self._arrivals.put(Arrival(self.connection, host_s, packet))
                    if data.endswith(b"\0") and len(data) < _MUCH:
                        time.sleep(_GATHER_S)
                return
            self.is_plugged = False
            self._port.close()
            while not self.is_plugged:
                if self._stop.wait(0.1):
                    return
                with suppress(UserError):
                    self.path = self._find()
                    self._port = open_port(self.path)
                    self.connection += 1
                    self.is_plugged = True
