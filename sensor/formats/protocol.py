"""SPADCAM's serial protocol: framing, checks and contents of packets.

A packet on the line is the COBS encoding of its body, then a zero byte, which occurs nowhere else:

    version u8 | kind u8 | sequence u32 | device time u64, µs | payload | Adler-32 | CRC-16

all little-endian. CRC-16 (polynomial 0x1021, from 0xFFFF) detects every burst of 16 bits, every odd
number of flipped bits and every two. It misses one in 2¹⁵ of other errors, which Adler-32 detects.
"""

import binascii
import struct
import zlib
from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import printable

VERSION = 1
ROWS = COLUMNS = 16
NOT_READ = 0xFFFF
"""Sample of a pixel outside the row window."""
NOMINAL_STEP_BIAS = 2048
"""Code at which the counters have their nominal step."""

_HEADER = struct.Struct("<BBIQ")
_ADLER = struct.Struct("<I")
_CRC = struct.Struct("<H")
_SETTINGS = struct.Struct("<HIIHBB")
_IDENTITY = struct.Struct("<BBBBHH16s32s")


class Kind(IntEnum):
    """Kinds of packets; from 16 on, those sent by the host."""

    FRAME = 1
    IDENTITY = 2
    SETTINGS = 3
    IDENTIFY = 16
    SET_EXPOSURE = 17
    SET_FRAME_RATE = 18
    SET_STEP_BIAS = 19
    SET_ROW_WINDOW = 20


_COMMANDS: dict[Kind, tuple[struct.Struct, tuple[str, ...]]] = {
    Kind.IDENTIFY: (struct.Struct("<"), ()),
    Kind.SET_EXPOSURE: (struct.Struct("<I"), ("exposure_us",)),
    Kind.SET_FRAME_RATE: (struct.Struct("<I"), ("frame_rate_mhz",)),
    Kind.SET_STEP_BIAS: (struct.Struct("<H"), ("step_bias",)),
    Kind.SET_ROW_WINDOW: (struct.Struct("<BB"), ("first_row", "end_row")),
}
"""Payload of each command, and its settings."""

PAYLOAD_BYTES = {
    Kind.FRAME: 2 * ROWS * COLUMNS,
    Kind.IDENTITY: _IDENTITY.size,
    Kind.SETTINGS: _SETTINGS.size,
    **{kind: payload.size for kind, (payload, _) in _COMMANDS.items()},
}
"""Payload length of each kind; packets of other lengths are damaged."""

_CHECKS = _ADLER.size + _CRC.size
_BODY_BYTES = {int(kind): _HEADER.size + n + _CHECKS for kind, n in PAYLOAD_BYTES.items()}
_LARGEST_BODY = max(_BODY_BYTES.values())
LONGEST = _LARGEST_BODY + -(-_LARGEST_BODY // 254)
"""Bytes of the longest packet on the line, without the zero."""


class Packet(NamedTuple):
    """One packet."""

    kind: Kind
    sequence: int
    """Frame: hardware frame counter, modulo 2³². Command: a number chosen by the host. Reply: the
    number of its command."""
    device_us: int
    """The camera's clock, µs: at the end of the exposure, or at the reply. 0 from the host."""
    payload: bytes


def encode(packet: Packet) -> bytes:
    """Return a packet as sent over the line, including its zero.

    Raises ValueError if the payload's length is not that of its kind.
    """
    from cobs import cobs

    if len(packet.payload) != PAYLOAD_BYTES[packet.kind]:
        raise ValueError(
            f"payload: {len(packet.payload)} bytes; {packet.kind.name} has "
            f"{PAYLOAD_BYTES[packet.kind]}"
        )
    header = _HEADER.pack(VERSION, packet.kind, packet.sequence, packet.device_us)
    return bytes(cobs.encode(_checked(header + packet.payload))) + b"\0"


class Parser:
    """Parser of packets from bytes that arrive in pieces.

    Attributes
    ----------
    damaged : int
        Packets refused so far.
    other_version : int or None
        Version of the last intact packet of another version.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self.other_version: int | None = None
        self._rest = b""
        self._is_too_long = False

    def feed(self, data: bytes) -> Iterator[Packet]:
        """Yield the packets that these bytes complete."""
        first, *later_frames = (self._rest + data).split(b"\0")
        self._rest = later_frames[-1] if later_frames else first
        for piece in [first, *later_frames][:-1]:
            if not piece and not self._is_too_long:
                continue
            packet = None if self._is_too_long else self._decoded(piece)
            if packet is not None:
                yield packet
            else:
                self.damaged += 1
            self._is_too_long = False
        # Data without an end that is already too long need not be kept.
        if len(self._rest) > LONGEST:
            self._rest, self._is_too_long = b"", True

    def _decoded(self, piece: bytes) -> Packet | None:
        from cobs import cobs

        if len(piece) > LONGEST:
            return None
        try:
            body = bytes(cobs.decode(piece))
        except cobs.DecodeError:
            return None
        content = body[:-_CHECKS]
        if len(content) < _HEADER.size or _checked(content) != body:
            return None
        version, kind, sequence, device_us = _HEADER.unpack_from(content)
        if version != VERSION:
            self.other_version = version
            return None
        if len(body) != _BODY_BYTES.get(kind):
            return None
        return Packet(Kind(kind), sequence, device_us, content[_HEADER.size :])


def _checked(content: bytes) -> bytes:
    """Content without its verified checksums."""
    summed = content + _ADLER.pack(zlib.adler32(content))
    return summed + _CRC.pack(binascii.crc_hqx(summed, 0xFFFF))


class Settings(NamedTuple):
    """Settings of the camera; reply to every command that changes one."""

    exposure_us: int = 50_000
    frame_rate_mhz: int = 10_000
    """Frames per 1000 s."""
    step_bias: int = NOMINAL_STEP_BIAS
    """Code of the 12-bit DAC that sets the step of the counters."""
    first_row: int = 0
    """First row of the row window, the rows that are read."""
    end_row: int = ROWS
    """Row after the last of the window."""
    refused: bool = False
    """True if the camera could not do what the command requested, and changed nothing."""

    @property
    def period_us(self) -> int:
        """Time from frame to frame, µs, rounded down as the camera does."""
        return 1_000_000_000 // self.frame_rate_mhz

    @property
    def are_possible(self) -> bool:
        """True if the exposure fits into the frame period and codes and rows exist."""
        return (
            self.frame_rate_mhz > 0
            and 0 < self.exposure_us <= self.period_us
            and 0 <= self.step_bias < 2**12
            and 0 <= self.first_row < self.end_row <= ROWS
        )

    def after(self, command: Packet) -> Self:
        """Return the settings after a command, with `refused` if it is impossible."""
        payload, names = _COMMANDS[command.kind]
        values = dict(zip(names, payload.unpack(command.payload), strict=True))
        wanted = self._replace(**values, refused=False)
        return wanted if wanted.are_possible else self._replace(refused=True)

    def payload(self) -> bytes:
        """Return the settings as bytes."""
        return _SETTINGS.pack(self.refused, *self[:-1])

    @classmethod
    def of(cls, payload: bytes) -> Self:
        """Return settings from bytes."""
        refused, *values = _SETTINGS.unpack(payload)
        return cls._make((*values, bool(refused)))


class Identity(NamedTuple):
    """Identity of the camera; control codes in its texts are escaped."""

    rows: int
    columns: int
    adc_bits: int
    supply_mv: int
    serial_number: str
    firmware: str

    def payload(self) -> bytes:
        """Return the identity as bytes."""
        texts = (text.encode("ascii") for text in (self.serial_number, self.firmware))
        return _IDENTITY.pack(self.rows, self.columns, self.adc_bits, 0, self.supply_mv, 0, *texts)

    @classmethod
    def of(cls, payload: bytes) -> Self:
        """Return an identity from bytes."""
        rows, columns, bits, _, supply_mv, _, *texts = _IDENTITY.unpack(payload)
        serial, firmware = (
            printable(text.rstrip(b"\0").decode("ascii", "backslashreplace")) for text in texts
        )
        return cls(rows, columns, bits, supply_mv, serial, firmware)


def frame_packet(sequence: int, device_us: int, samples: NDArray[np.uint16]) -> Packet:
    """Return a frame of (16, 16) ADC samples as a packet."""
    values = np.ascontiguousarray(samples, "<u2").tobytes()
    return Packet(Kind.FRAME, sequence & 0xFFFFFFFF, device_us, values)


def samples_of(packet: Packet) -> NDArray[np.uint16]:
    """Return the (16, 16) ADC samples of a frame."""
    return np.frombuffer(packet.payload, "<u2").reshape(ROWS, COLUMNS)


def command(kind: Kind, *values: int) -> tuple[Kind, bytes]:
    """Return kind and payload of a command with these values, in the order of `Settings`."""
    return kind, _COMMANDS[kind][0].pack(*values)
