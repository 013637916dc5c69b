"""Format numbers of everything that the program writes; CONTRIBUTING says when to raise one."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from megalopta.core.errors import UserError


class Format(NamedTuple):
    """Number written today, and the oldest one still read; 0 predates format numbers."""

    written: int
    oldest_read: int


FORMATS: Mapping[str, Format] = {
    "dataset": Format(2, 2),  # dataset.yaml of one sequence or of many, and its results
    "sequence": Format(3, 3),  # sequences/SEQ.json
    "counts": Format(1, 0),  # SENSOR-LEVEL.zarr and every other Zarr store
    "events": Format(1, 0),  # SENSOR-LEVEL.events.h5
    "recording": Format(2, 2),  # recording.yaml
    "ranking": Format(4, 4),  # ranking.json
    "scores": Format(3, 0),  # scores.json
}
"""Every format by its name in messages."""


def check_format(kind: str, record: Mapping[str, Any], path: object, key: str = "format") -> None:
    """Refuse a record of a format that this program cannot read.

    Raises UserError if the number is newer than the program, too old for it, or missing.
    """
    newest, oldest = FORMATS[kind]
    number = record.get(key, 0)
    if type(number) is not int or number < 0:
        raise UserError(
            f"{path}: {key} is {str(number)[:50]!r}, not a format number; restore the file"
        )
    if number > newest:
        raise UserError(
            f"{path}: {kind} format {number} is newer than {newest}, the newest that this "
            "program reads; update megalopta"
        )
    if number < oldest:
        raise UserError(
            f"{path}: {kind} format {number} is older than {oldest}, the oldest that this "
            "program reads; read it with the release that wrote it, or regenerate it"
        )
