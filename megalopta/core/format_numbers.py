"""Format numbers of everything the program writes. Every room may import this module.

A number is raised whenever an older program would misread what is written now. CONTRIBUTING says
when to raise one and how long older ones are read.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from megalopta.core.errors import UserError


class Format(NamedTuple):
    """Number written today, and the oldest still read; 0 is from before there were numbers."""

    written: int
    oldest_read: int


FORMATS: Mapping[str, Format] = {
    "dataset": Format(2, 2),  # dataset.yaml, of one sequence or of many, and all results there
    "sequence": Format(2, 2),  # sequences/SEQ.json
    "counts": Format(1, 0),  # SENSOR-LEVEL.zarr and every other Zarr store
    "events": Format(1, 0),  # SENSOR-LEVEL.events.h5 and .events.npz
    "recording": Format(1, 0),  # recording.yaml
    "ranking": Format(2, 2),  # ranking.json
    "scores": Format(2, 0),  # scores.json, and lines of a leaderboard
}
"""Every format by the name that messages use."""


def written(kind: str) -> int:
    """Return the number to write with something of a kind."""
    return FORMATS[kind].written


def check_format(kind: str, record: Mapping[str, Any], path: object, key: str = "format") -> None:
    """Refuse what this program cannot read.

    Raises UserError when the number in a record is newer than the program, too old for it, or no
    number.
    """
    newest, oldest = FORMATS[kind]
    found = record.get(key, 0)
    if type(found) is not int or found < 0:
        raise UserError(
            f"{path}: {key} is {str(found)[:50]!r}, not a format number; restore the file"
        )
    if found > newest:
        raise UserError(
            f"{path}: {kind} format {found} is newer than {newest}, which this program reads; "
            "update megalopta"
        )
    if found < oldest:
        raise UserError(
            f"{path}: {kind} format {found} is older than {oldest}, which this program reads; "
            "read it with the release that wrote it, or make it again"
        )
