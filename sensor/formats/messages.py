"""What is in the packets: frames, settings, who the camera is, and the commands to it."""

import struct
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import printable
from megalopta.sensor.formats.packets import Kind, Packet

ROWS = COLUMNS = 16
NOT_READ = 0xFFFF
"""Sample of a pixel outside the row window."""
NOMINAL_STEP_BIAS = 2048
"""Code at which the counters have their nominal step."""
LARGEST_STEP_BIAS = 4095

_SETTINGS = struct.Struct("<HIIHBB")
_IDENTITY = struct.Struct("<BBBBHH16s32s")


class Settings(NamedTuple):
    """What the camera works with; reply to every command that sets something.

    Attributes
    ----------
    exposure_us : int
    frame_rate_mhz : int
        Frames per 1000 s.
    step_bias : int
        Code of the 12-bit DAC that sets the step of the counters.
    first_row, end_row : int
        The row window: first row that is read, and the one after the last.
    refused : bool
        The command asked for what the camera cannot do, and changed nothing.
    """

    exposure_us: int = 50_000
    frame_rate_mhz: int = 10_000
    step_bias: int = NOMINAL_STEP_BIAS
    first_row: int = 0
    end_row: int = ROWS
    refused: bool = False

    @property
    def period_us(self) -> int:
        """Time from frame to frame, µs, rounded down as the camera does."""
        return 1_000_000_000 // self.frame_rate_mhz

    @property
    def are_possible(self) -> bool:
        """Whether a frame is exposed before the next begins, and codes and rows exist."""
        return (
            self.frame_rate_mhz > 0
            and 0 < self.exposure_us <= self.period_us
            and 0 <= self.step_bias <= LARGEST_STEP_BIAS
            and 0 <= self.first_row < self.end_row <= ROWS
        )

    def after(self, command: Packet) -> Self:
        """What a command makes of them; with `refused` where it is impossible."""
        wanted = self._replace(**_wanted(command))._replace(refused=False)
        return wanted if wanted.are_possible else self._replace(refused=True)

    def payload(self) -> bytes:
        """As bytes."""
        return _SETTINGS.pack(self.refused, *self[:-1])

    @classmethod
    def of(cls, payload: bytes) -> Self:
        """From bytes."""
        refused, *values = _SETTINGS.unpack(payload)
        return cls._make((*values, bool(refused)))


class Identity(NamedTuple):
    """Who the camera is; of its texts, control codes are escaped."""

    rows: int
    columns: int
    adc_bits: int
    supply_mv: int
    serial_number: str
    firmware: str

    def payload(self) -> bytes:
        """As bytes."""
        texts = (text.encode("ascii") for text in (self.serial_number, self.firmware))
        return _IDENTITY.pack(self.rows, self.columns, self.adc_bits, 0, self.supply_mv, 0, *texts)

    @classmethod
    def of(cls, payload: bytes) -> Self:
        """From bytes."""
        rows, columns, bits, _, supply_mv, _, *texts = _IDENTITY.unpack(payload)
        serial, firmware = (
            printable(text.rstrip(b"\0").decode("ascii", "backslashreplace")) for text in texts
        )
        return cls(rows, columns, bits, supply_mv, serial, firmware)


def frame_packet(sequence: int, device_us: int, samples: NDArray[np.uint16]) -> Packet:
    """A frame of (16, 16) ADC samples as a packet."""
    values = np.ascontiguousarray(samples, "<u2").tobytes()
    return Packet(Kind.FRAME, sequence & 0xFFFFFFFF, device_us, values)


def samples_of(packet: Packet) -> NDArray[np.uint16]:
    """The (16, 16) ADC samples of a frame."""
    return np.frombuffer(packet.payload, "<u2").reshape(ROWS, COLUMNS)


def identify() -> tuple[Kind, bytes]:
    """Ask who the camera is: kind and payload, as those below."""
    return Kind.IDENTIFY, b""


def set_exposure(exposure_us: int) -> tuple[Kind, bytes]:
    """Set how long a frame is exposed."""
    return Kind.SET_EXPOSURE, struct.pack("<I", exposure_us)


def set_frame_rate(frame_rate_mhz: int) -> tuple[Kind, bytes]:
    """Set the frame rate, in frames per 1000 s."""
    return Kind.SET_FRAME_RATE, struct.pack("<I", frame_rate_mhz)


def set_step_bias(code: int) -> tuple[Kind, bytes]:
    """Set the bias of the counters' step."""
    return Kind.SET_STEP_BIAS, struct.pack("<H", code)


def set_row_window(first: int, end: int) -> tuple[Kind, bytes]:
    """Set which rows are read."""
    return Kind.SET_ROW_WINDOW, struct.pack("<BB", first, end)


def _wanted(command: Packet) -> dict[str, Any]:
    if command.kind == Kind.SET_ROW_WINDOW:
        first, end = command.payload
        return {"first_row": first, "end_row": end}
    names = {
        Kind.SET_EXPOSURE: "exposure_us",
        Kind.SET_FRAME_RATE: "frame_rate_mhz",
        Kind.SET_STEP_BIAS: "step_bias",
    }
    return {names[command.kind]: int.from_bytes(command.payload, "little")}
