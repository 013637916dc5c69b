"""Packets of SPADCAM's serial line: framed, checked, and found again in a damaged stream.

A packet on the line is COBS of its body, then a zero byte, which occurs nowhere else:

    version u8 | kind u8 | sequence u32 | device time u64, µs | payload | Adler-32 | CRC-16

all little-endian. CRC-16 (polynomial 0x1021, from 0xFFFF) finds every burst of 16 bits, every odd
number of flipped bits and every two; of other damage it lets one in 2¹⁵ pass, which Adler-32 finds.
"""

import binascii
import struct
import zlib
from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

from cobs import cobs

VERSION = 1

_HEADER = struct.Struct("<BBIQ")
_ADLER = struct.Struct("<I")
_CRC = struct.Struct("<H")
_CRC_START = 0xFFFF


class Kind(IntEnum):
    """What a packet is; from 16 on, what the host sends."""

    FRAME = 1
    IDENTITY = 2
    SETTINGS = 3
    IDENTIFY = 16
    SET_EXPOSURE = 17
    SET_FRAME_RATE = 18
    SET_STEP_BIAS = 19
    SET_ROW_WINDOW = 20


PAYLOAD_BYTES = {
    Kind.FRAME: 512,
    Kind.IDENTITY: 56,
    Kind.SETTINGS: 14,
    Kind.IDENTIFY: 0,
    Kind.SET_EXPOSURE: 4,
    Kind.SET_FRAME_RATE: 4,
    Kind.SET_STEP_BIAS: 2,
    Kind.SET_ROW_WINDOW: 2,
}
"""A packet of another length is damaged."""

_CHECKS = _ADLER.size + _CRC.size
_BODY_BYTES = {int(kind): _HEADER.size + n + _CHECKS for kind, n in PAYLOAD_BYTES.items()}
_LARGEST_BODY = max(_BODY_BYTES.values())
LONGEST = _LARGEST_BODY + -(-_LARGEST_BODY // 254)
"""Bytes of the longest packet on the line, without the zero."""


class Packet(NamedTuple):
    """One packet.

    Attributes
    ----------
    kind : Kind
    sequence : int
        Of a frame: the hardware frame counter, modulo 2³². Of a command: a number that the host
        chooses. Of a reply: that of its command.
    device_us : int
        The camera's clock, µs: at the end of the exposure, or when it replied. 0 from the host.
    payload : bytes
    """

    kind: Kind
    sequence: int
    device_us: int
    payload: bytes


def encode(packet: Packet) -> bytes:
    """A packet as it goes over the line, its zero included.

    Raises
    ------
    ValueError
        When the payload has not the length of its kind.
    """
    if len(packet.payload) != PAYLOAD_BYTES[packet.kind]:
        raise ValueError(
            f"payload: {len(packet.payload)} bytes; {packet.kind.name} has "
            f"{PAYLOAD_BYTES[packet.kind]}"
        )
    header = _HEADER.pack(VERSION, packet.kind, packet.sequence, packet.device_us)
    return bytes(cobs.encode(_checked(header + packet.payload))) + b"\0"


class Parser:
    """Packets out of bytes that come in any pieces.

    Attributes
    ----------
    damaged : int
        Packets refused so far.
    other_version : int or None
        Version of the last packet that was whole but not of this one.
    place : int
        Where the packet begins that was yielded last, in bytes from the first that were fed.
    """

    def __init__(self) -> None:
        self.damaged = self.place = 0
        self.other_version: int | None = None
        self._rest = b""
        self._fed = 0
        self._is_too_long = False

    def feed(self, data: bytes) -> Iterator[Packet]:
        """Yield the packets that these bytes complete."""
        end = self._fed - len(self._rest)
        self._fed += len(data)
        first, *others = (self._rest + data).split(b"\0")
        self._rest = others[-1] if others else first
        for piece in [first, *others][:-1]:
            self.place, end = end, end + len(piece) + 1
            if not piece and not self._is_too_long:
                continue
            packet = None if self._is_too_long else self._decoded(piece)
            if packet is not None:
                yield packet
            else:
                self.damaged += 1
            self._is_too_long = False
        # What has no end yet and is too long already need not be kept.
        if len(self._rest) > LONGEST:
            self._rest, self._is_too_long = b"", True

    def _decoded(self, piece: bytes) -> Packet | None:
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
    """Content with its checks."""
    summed = content + _ADLER.pack(zlib.adler32(content))
    return summed + _CRC.pack(binascii.crc_hqx(summed, _CRC_START))
