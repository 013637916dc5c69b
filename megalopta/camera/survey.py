"""Contents of a file of bytes from the camera: when it was plugged in, and how it was set.

The camera says who it is and what it was set to, so raw.bin tells it, too. Where a camera was
unplugged and plugged in again it tells this by its clock, which starts anew, and by the host, which
asks again who it is; `offsets` are those places, as far as they are known.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from megalopta.core.errors import UserError
from megalopta.sensor.formats.protocol import Identity, Kind, Packet, Parser, Settings

_PIECE_BYTES = 256 * 1024
_COMMANDS = 5
"""Replies with settings, at least, after which a capture takes frames."""
_UNANSWERED_US = 3_000_000
"""A capture does not ask for longer; after fewer settings than it wanted it takes no frames."""


@dataclass
class Stretch:
    """Bytes between plugging and unplugging.

    Attributes
    ----------
    begin, end : int
        Places in the file.
    identity : Identity or None
    settings : Settings or None
        What the camera was set to at last.
    replies : int
        With settings.
    valid_us : int
        By the camera's clock, when the first exposure with them may end, µs.
    first_us, last_us : int or None
        By the camera's clock: when it said who it is, or else the first packet, and the last frame.
    frames, taken : int
        Of any settings, and with the last.
    """

    begin: int
    end: int
    identity: Identity | None = None
    settings: Settings | None = None
    replies: int = 0
    valid_us: int = 0
    first_us: int | None = None
    last_us: int | None = None
    frames: int = 0
    taken: int = 0

    def sees(self, packet: Packet) -> None:
        """Note a packet."""
        if self.first_us is None or packet.kind == Kind.IDENTITY:
            self.first_us = packet.device_us
        if packet.kind == Kind.FRAME:
            self.frames += 1
            self.taken += packet.device_us >= self.valid_us
            self.last_us = packet.device_us
        elif packet.kind == Kind.IDENTITY:
            self.identity = Identity.of(packet.payload)
        elif packet.kind == Kind.SETTINGS:
            self.settings = Settings.of(packet.payload)
            self.replies, self.taken = self.replies + 1, 0
            self.valid_us = packet.device_us + self.settings.exposure_us

    def is_over(self, packet: Packet) -> bool:
        """Return whether a packet is of a camera that began anew."""
        if packet.kind == Kind.FRAME:
            return self.last_us is not None and packet.device_us < self.last_us
        return packet.kind == Kind.IDENTITY and self.settings is not None


class Survey(NamedTuple):
    """Stretches of a file, those in which the camera was set, and how many packets are damaged."""

    stretches: Sequence[Stretch]
    set_ones: Sequence[Stretch]
    damaged: int


def survey_file(raw: Path, offsets: Sequence[int], read: Callable[[int], None]) -> Survey:
    """Go through a file once; `read` is told how many bytes were read.

    Raises
    ------
    UserError
        When the camera says what it cannot be set to, or is set in two ways.
    """
    size = raw.stat().st_size
    places = sorted({0, size, *(each for each in offsets if 0 < each < size)})
    stretches: list[Stretch] = []
    damaged = 0
    for begin, end in pairwise(places):
        parser = Parser()
        stretches.append(Stretch(begin, end))
        for place, packet in packets_of(raw, begin, end, parser, read):
            if stretches[-1].is_over(packet):
                stretches[-1].end = place
                stretches.append(Stretch(place, end))
            stretches[-1].sees(packet)
        damaged += parser.damaged
    return Survey(stretches, _set_ones(stretches, raw), damaged)


def packets_of(
    raw: Path, begin: int, end: int, parser: Parser, read: Callable[[int], None]
) -> Iterator[tuple[int, Packet]]:
    """Yield packets of a part of a file, and where they begin in it."""
    with raw.open("rb") as file:
        file.seek(begin)
        left = end - begin
        while left > 0 and (data := file.read(min(_PIECE_BYTES, left))):
            left -= len(data)
            for packet in parser.feed(data):
                yield begin + parser.place, packet
            read(len(data))


def _set_ones(stretches: Sequence[Stretch], raw: Path) -> Sequence[Stretch]:
    """Those in which the camera was set like in that with the most frames."""
    answered = [each for each in stretches if each.replies >= _COMMANDS]
    if not answered:
        return ()
    most = max(answered, key=lambda each: each.taken)
    assert most.settings is not None
    if not most.settings.are_possible:
        raise UserError(f"{raw}: the camera says {_said(most.settings)}; give another file")
    same = [each for each in answered if _whose(each) == _whose(most)]
    for each in answered:
        if each not in same and (each.last_us or 0) - each.valid_us > _UNANSWERED_US:
            raise UserError(
                f"{raw}: two recordings: from byte {each.begin} on it is another camera, or set "
                "otherwise; cut the file there"
            )
    return same


def _whose(stretch: Stretch) -> tuple[Settings | None, str | None]:
    return stretch.settings, stretch.identity and stretch.identity.serial_number


def _said(settings: Settings) -> str:
    return ", ".join(f"{name} {value}" for name, value in settings._asdict().items())
