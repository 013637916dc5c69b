"""Serial ports: which there are, which is the camera's, and why one does not open."""

import errno
from collections.abc import Iterator
from typing import NamedTuple

import serial
from serial.tools import list_ports

from megalopta.core.bounded import printable
from megalopta.core.errors import UserError

TEENSY_VENDOR = 0x16C0
UDEV_RULE = (
    'SUBSYSTEM=="tty", ATTRS{idVendor}=="16c0", MODE="0660", GROUP="dialout", '
    'ENV{ID_MM_DEVICE_IGNORE}="1"'
)
"""For /etc/udev/rules.d/: who may open the port, and that ModemManager must not."""

_LIST = "see megalopta spadcam list"
_EMULATE = "start an emulated one (megalopta spadcam emulate)"
_REMEDIES = {
    errno.ENOENT: f"no such port; plug the camera in, {_EMULATE}, or choose another ({_LIST})",
    **dict.fromkeys(
        (errno.ENODEV, errno.ENXIO),
        f"no device behind this port; plug the camera in again, or choose another ({_LIST})",
    ),
    errno.EACCES: (
        "not permitted; join its group (sudo usermod -aG dialout $USER, then log in again), or put "
        "this rule into /etc/udev/rules.d/49-spadcam.rules and plug the camera in again: "
        f"{UDEV_RULE}"
    ),
    **dict.fromkeys(
        (errno.EBUSY, errno.EAGAIN),
        "another program has it open; close that one. If it is ModemManager, keep it away: "
        f"sudo systemctl stop ModemManager, or the udev rule {UDEV_RULE}",
    ),
}


class NoPortError(UserError):
    """There is no such port, yet."""


class UsbPort(NamedTuple):
    """A serial port of this machine; of a device's texts, control codes are escaped."""

    path: str
    vendor: int | None
    serial_number: str
    description: str


def usb_ports() -> list[UsbPort]:
    """Serial ports on USB."""
    found = [each for each in list_ports.comports() if each.vid is not None]
    return [
        UsbPort(
            each.device,
            each.vid,
            printable(each.serial_number or ""),
            printable(each.description or ""),
        )
        for each in found
    ]


def find_port(serial_number: str | None = None) -> str:
    """Path of the camera's port: of a USB serial number, or the only Teensy.

    Raises
    ------
    UserError
        When there is none (NoPortError), or more than one.
    """
    teensies = [port for port in usb_ports() if port.vendor == TEENSY_VENDOR]
    fitting = [port for port in teensies if serial_number in (None, port.serial_number)]
    if len(fitting) == 1:
        return fitting[0].path
    if fitting:
        choice = ", ".join(f"{port.path} ({port.serial_number})" for port in fitting)
        raise UserError(f"several cameras: {choice}; choose one with --port or --usb-serial")
    who = f"no camera of USB serial number {serial_number}" if serial_number else "no camera"
    raise NoPortError(f"{who} is plugged in; plug it in, give its --port ({_LIST}), or {_EMULATE}")


def open_port(path: str) -> serial.Serial:
    """Open a port for nobody else.

    Raises
    ------
    UserError
        When it does not open; NoPortError when there is none.
    """
    try:
        # USB ignores the baud rate.
        return serial.Serial(path, 115200, timeout=0.1, write_timeout=1, exclusive=True)
    except serial.SerialException as problem:
        remedy = _REMEDIES.get(problem.errno or 0, f"no serial port; choose another ({_LIST})")
        kind = NoPortError if problem.errno == errno.ENOENT else UserError
        raise kind(f"{path}: {remedy}") from None


def port_lines() -> Iterator[str]:
    """A line for every serial port on USB: path, serial number, what it is, whether it opens."""
    for port in usb_ports():
        is_teensy = "Teensy" if port.vendor == TEENSY_VENDOR else "other"
        try:
            open_port(port.path).close()
            state = "free"
        except UserError as problem:
            state = str(problem).partition(": ")[2].partition(";")[0]
        yield f"{port.path}  {port.serial_number or '-'}  {is_teensy}  {port.description}  {state}"
