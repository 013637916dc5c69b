"""What is known of a finished sequence."""

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from megalopta.errors import UserError
from megalopta.freshness import digest


class ExposureStatistics(BaseModel, frozen=True, use_attribute_docstrings=True):
    """Of what one sensor read at one light level."""

    name: str
    """Of its files, such as "spadcam-starlight" """
    sensor: str
    level: float | str
    unit: str
    """Of the readings"""
    exposure_s: float
    photons_per_pixel: float
    """Mean of the expected photons on a pixel, an exposure"""
    mean_reading: float
    saturated_fraction: float


class SequenceStatistics(BaseModel, frozen=True, use_attribute_docstrings=True):
    """Of a sequence, over all pixels of all frames."""

    mean_speed_px: float | None
    """Of the forward flow, px a frame; None where none is defined, as for the next three"""
    median_speed_px: float | None
    percentile_99_speed_px: float | None
    unmatched_fraction: float
    """Of the pixels: hidden in the next frame, or out of view"""
    sky_fraction: float
    median_depth_m: float | None
    """Without the sky"""
    texture: float
    """Root mean square difference between neighboring pixels' light, relative to the mean"""
    exposures: tuple[ExposureStatistics, ...]


class SequenceRecord(BaseModel, frozen=True, use_attribute_docstrings=True):
    """What is known of a finished sequence."""

    sequence: str
    """Its name"""
    index: int
    split: str
    version: str
    """Of the program"""
    models: dict[str, str]
    """What of the program each stage depends on (`freshness`)"""
    configuration: dict[str, Any]
    statistics: SequenceStatistics
    poses: tuple[tuple[float, ...], ...]
    """Of every frame the matrix (4, 4) from camera axes (+x right, +y down, +z forward) to world
    meters, row by row"""
    files: dict[str, tuple[int, str]]
    """Every file by its path in the dataset: bytes and BLAKE2b hash (16 bytes, hexadecimal)"""

    @property
    def configuration_hash(self) -> str:
        """Fingerprint of all settings."""
        return digest(json.dumps(self.configuration, sort_keys=True))

    @property
    def frames(self) -> int:
        """How many frames it has."""
        return int(self.configuration["trajectory"]["frames"])


def read_record(path: Path) -> SequenceRecord:
    """Read a record. Raises UserError."""
    try:
        return SequenceRecord.model_validate_json(path.read_bytes())
    except OSError as problem:
        raise UserError(f"{path}: {problem.strerror}; make the dataset again") from None
    except ValidationError:
        raise UserError(
            f"{path} is damaged; remove it and run megalopta dataset make again"
        ) from None
