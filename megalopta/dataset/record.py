"""Record of a sequence: its settings, the software of each stage, and the hash of every file."""

import re
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, FiniteFloat

from megalopta.config.drawing import sequence_name
from megalopta.config.model import Configuration
from megalopta.core import bounded
from megalopta.core.errors import DamagedFileError, UserError
from megalopta.core.format_numbers import check_format
from megalopta.core.validation import checked

MADE = ("render", "sense")
"""Stages of every sequence of a plan."""
STAGE_NAMES = (*MADE, "flow", "benchmark")
KINDS = (
    *("radiance", "truth", "radiance_shutter", "truth_shutter"),
    *("pictures", "counts", "corrected", "results"),
)
"""Folders of a dataset with a folder per sequence, next to those in `training`."""
_KIND = re.compile(rf"{'|'.join(KINDS)}|training/[a-z][a-z0-9_]*")
_REMEDY = "restore it, or remove it and make the sequence again"


class ExposureStatistics(BaseModel, frozen=True, use_attribute_docstrings=True):
    """Statistics of one sensor's readings at one light level."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$")]
    """Base name of the exposure's files, such as "spadcam-starlight"."""
    sensor: str
    level: float | str
    unit: str
    """Unit of the readings"""
    exposure_s: float
    photons_per_pixel: float
    """Mean expected photons per pixel and exposure"""
    mean_reading: float
    saturated_fraction: float
    light_fraction: float | None = None
    """Share of the mean events that light made; the rest is dark, or None if unknown"""
    snr: float | None = None
    """Light's part of a pixel's mean reading, over the reading's RMS noise; None if unknown"""


class SequenceStatistics(BaseModel, frozen=True, use_attribute_docstrings=True):
    """Statistics of a sequence, over all pixels of all frames."""

    mean_speed_px: float | None
    """Speed of the forward flow, px per frame; None if undefined, as for the next three"""
    median_speed_px: float | None
    percentile_99_speed_px: float | None
    unmatched_fraction: float
    """Share of pixels hidden in the next frame, or out of view"""
    sky_fraction: float
    median_depth_m: float | None
    """Median depth without the sky"""
    texture: float
    """RMS difference of neighboring pixels' light, relative to the mean"""
    exposures: tuple[ExposureStatistics, ...]


class StageRecord(BaseModel, frozen=True, use_attribute_docstrings=True):
    """Record of one stage of a sequence."""

    settings: str
    """Hash of the settings that its output depends on"""
    made_with: dict[str, str]
    """Other dependencies: model of the program, libraries and their back ends"""
    version: str
    """Version of the program"""
    files: dict[str, tuple[int, str]] | None = None
    """Every file by its path in the dataset: bytes and BLAKE2b hash (16 bytes, hexadecimal); None
    of a stage in progress"""


class SequenceRecord(BaseModel, frozen=True, use_attribute_docstrings=True):
    """Record of a sequence; for one of a plan, also its place and statistics."""

    format: int
    """Format of this file (`format_numbers`)"""
    sequence: str
    """Its name"""
    configuration: dict[str, Any] = {}
    """Settings of all stages"""
    stages: dict[str, StageRecord] = {}
    index: int = Field(default=0, ge=0)
    split: str = "all"
    statistics: SequenceStatistics | None = None
    poses: tuple[Annotated[tuple[FiniteFloat, ...], Field(min_length=16, max_length=16)], ...] = ()
    """Pose of every frame: matrix (4, 4), row by row, from camera axes (+x right, +y down, +z
    forward) to world meters"""

    @property
    def files(self) -> dict[str, tuple[int, str]]:
        """All files of finished stages: bytes and hash."""
        written = (stage.files or {} for stage in self.stages.values())
        return {path: size_and_hash for hashes in written for path, size_and_hash in hashes.items()}

    @property
    def folders(self) -> list[str]:
        """Folders that hold these files and no others, such as "training/flow/000003"."""
        end = f"/{self.sequence}"
        return list(dict.fromkeys(path.partition(f"{end}/")[0] + end for path in self.files))

    @property
    def exposures(self) -> tuple[ExposureStatistics, ...]:
        """Statistics of its exposures, if measured."""
        return self.statistics.exposures if self.statistics else ()

    def without(self, stages: Collection[str]) -> "SequenceRecord":
        """Return the record without some stages."""
        left = {name: stage for name, stage in self.stages.items() if name not in stages}
        return self.model_copy(update={"stages": left})

    def to_json(self) -> str:
        """Return the text of the file."""
        return self.model_dump_json(indent=1, exclude_unset=True) + "\n"


def read_record(path: Path, name: str) -> SequenceRecord:
    """Return the record of a named sequence.

    Raises UserError, with the remedy, if it is missing or damaged.
    """
    try:
        values = bounded.read_json(path)
        check_format("sequence", values, path)
        record = checked(SequenceRecord, values)
        _check_names(record, name)
    except OSError as problem:
        raise UserError(f"{path}: {problem.strerror}; {_REMEDY}") from None
    except (AttributeError, TypeError):
        raise _damaged(path, "no record") from None
    except ValueError as problem:
        raise _damaged(path, bounded.quoted(str(problem))) from None
    return record


def stored_settings(record: SequenceRecord, path: Path) -> Configuration:
    """Return the settings in a record. Raises DamagedFileError."""
    try:
        settings = checked(Configuration, record.configuration, {"folder": path.parents[1]})
    except ValueError as problem:
        reason = f"configuration: {problem}"
        raise _damaged(path, bounded.quoted(reason, 400)) from None
    if settings.name != record.sequence:
        raise _damaged(path, f"configuration: it belongs to {bounded.quoted(settings.name, 60)!r}")
    if record.poses and settings.trajectory.frames != len(record.poses):
        raise _damaged(path, f"{len(record.poses)} poses of {settings.trajectory.frames} frames")
    return settings


def _check_names(record: SequenceRecord, name: str) -> None:
    """Refuse, with ValueError, names that are not a sequence's own: they might lead elsewhere."""
    if record.sequence != name:
        raise ValueError(f"it belongs to sequence {bounded.quoted(record.sequence, 60)!r}")
    if not record.split.isidentifier():
        raise ValueError(f"{bounded.quoted(record.split, 60)!r} cannot name a split")
    if strangers := record.stages.keys() - STAGE_NAMES:
        raise ValueError(f"{bounded.quoted(min(strangers), 60)!r} is not a stage")
    if record.statistics and sequence_name(record.index) != name:
        raise ValueError(f"index {record.index} is that of {sequence_name(record.index)!r}")
    for path in record.files:
        kind, _, below = path.partition(f"/{name}/")
        is_plain = not set(below.split("/")) & {"", "..", "."} and "\0" not in path
        if not (is_plain and _KIND.fullmatch(kind)):
            raise ValueError(f"{bounded.quoted(path, 60)!r} is not a file of this sequence")


def _damaged(path: Path, why: str) -> DamagedFileError:
    return DamagedFileError(f"{path} is damaged ({why}); {_REMEDY}")
