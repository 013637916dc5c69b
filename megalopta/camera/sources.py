"""Recordings to calibrate from or to compare, as named on the command line or in a list.

A recording is named RECORDING or RECORDING@LIGHT; another camera's file of counts
(`megalopta.sensor.formats`) is FILE@LIGHT:EXPOSURE_S. A range of frames, for a recording of several
lights, is RECORDING#0-100@LIGHT. A list is YAML, with paths relative to it:

    recordings:
      - {path: dark.npy, exposure_s: 1.0e-3}
      - {path: flat, exposure_s: 1.0e-5, light: 2.0e7, format: swissspad2, frames: [0, 1000]}
      - {path: 8-bit.npy, exposure_s: 1.0e-5, light: 2.0e7, sums: 255}
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.camera.recording import is_recording, open_recording
from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.bounded import read_text
from megalopta.core.errors import UserError, refused_as
from megalopta.core.record import Record
from megalopta.core.validation import checked
from megalopta.sensor import Sensor
from megalopta.sensor.formats.reading import FrameKind, read_frames

_LIST_BYTES = 2**20
_PLANCK_TIMES_C = 1.98644586e-25


@dataclass(frozen=True)
class Source:
    """A recording and its light."""

    path: Path
    light: float = 0.0
    """As given: photons per second and pixel, or watts of the beam; 0: dark."""
    exposure_s: float | None = None
    frames: tuple[int, int] | None = None
    """First frame, and the frame after the last; none: all."""
    kind: FrameKind | None = None
    """Format of another camera's file; none: by its content, counts or bits of .npy by their type.
    """
    sums: int | None = None
    """Binary frames that each frame of the file is the sum of; none: frames are as recorded."""

    @classmethod
    def parse(cls, text: str, kind: FrameKind | None = None) -> "Source":
        """Parse RECORDING, RECORDING@LIGHT or RECORDING#FIRST-END@LIGHT:EXPOSURE_S.

        Raises UserError if light or exposure is not a number, or negative, or a range of frames is
        invalid.
        """
        name, at, numbers = text.partition("@")
        if not at and ":" in Path(name).name and not Path(name).exists():
            raise UserError(f"{text!r}: give RECORDING@LIGHT:EXPOSURE_S, in the dark @0:EXPOSURE_S")
        path, hash_, range_ = name.partition("#")
        light, _, exposure = numbers.partition(":")
        try:
            values = float(light or 0), float(exposure) if exposure else None
        except ValueError:
            raise UserError(f"{text!r}: give RECORDING@LIGHT, with a number after the @") from None
        if not 0 <= values[0] < np.inf or (values[1] is not None and not 0 < values[1] < np.inf):
            raise UserError(f"{text!r}: invalid light or exposure; give positive numbers")
        frames = None
        if hash_:
            first, _, end = range_.partition("-")
            if not (first.isdecimal() and end.isdecimal() and int(first) < int(end)):
                raise UserError(f"{text!r}: give RECORDING#FIRST-END, such as #0-100")
            frames = int(first), int(end)
        return cls(Path(path), *values, frames, kind)


class _Listed(Record, frozen=True):
    """Recording of a list."""

    path: str
    """File or folder, relative to the list."""
    exposure_s: Annotated[float, Field(gt=0)] | None = None
    """Exposure of a frame (s); null: that of the file."""
    light: Annotated[float, Field(ge=0)] = 0.0
    """Photons per second and pixel, or watts of the beam; 0: dark."""
    format: FrameKind | None = None
    """Format of the file; null: by its content."""
    frames: tuple[Annotated[int, Field(ge=0)], int] | None = None
    """First frame, and the frame after the last; null: all."""
    sums: Annotated[int, Field(ge=2)] | None = None
    """Binary frames that each frame of the file is the sum of. `exposure_s` is that of one."""


class _List(Record, frozen=True):
    recordings: Annotated[tuple[_Listed, ...], Field(min_length=1)]
    """Recordings of one camera."""


def named_sources(words: Sequence[str]) -> list[Source]:
    """Return the recordings of RECORDING@LIGHT, or of one .yaml list. Raises UserError."""
    if len(words) != 1 or not words[0].endswith((".yaml", ".yml")):
        return [Source.parse(text) for text in words]
    path = Path(words[0])
    try:
        listed = checked(_List, strict_yaml.load(read_text(path, _LIST_BYTES))).recordings
    except OSError as error:
        raise UserError(
            f"{path} cannot be read ({error.strerror}); give a YAML list of recordings"
        ) from None
    except ValueError as error:
        raise UserError(f"{path}: {error}") from None
    for each in listed:
        if each.frames is not None and each.frames[1] <= each.frames[0]:
            raise UserError(f"{path}: frames {list(each.frames)}; give the first and a later one")
    return [
        Source(path.parent / e.path, e.light, e.exposure_s, e.frames, e.format, e.sums)
        for e in listed
    ]


@dataclass(frozen=True)
class Beam:
    """Light of flat frames, if it is known as a beam's power."""

    wavelength_nm: float | None = None
    area_mm2: float | None = None
    """None: light is given as photons per second and pixel."""

    def photons_hz(self, light: float, sensor: Sensor) -> float:
        """Photons per second and pixel; relative if the wavelength is unknown.

        Raises ValueError if the sensor's curve has no efficiency at the wavelength.
        """
        curve, nm = sensor.efficiency, self.wavelength_nm
        if nm is None:
            if self.area_mm2 is not None:
                raise ValueError(
                    "--beam-area-mm2: give --wavelength-nm too, to convert watts to photons"
                )
            return light
        first, last = curve.wavelengths_nm[0], curve.wavelengths_nm[-1]
        if not (first <= nm <= last and curve(np.array(nm)) > 0):
            raise ValueError(
                f"--wavelength-nm {nm:g}: sensor {sensor.name!r} has no efficiency there, only "
                f"within {first:g} to {last:g} nm; give the wavelength of the light"
            )
        if self.area_mm2 is None:
            return light
        return light * nm * 1e-9 / _PLANCK_TIMES_C * sensor.pitch_m**2 / (self.area_mm2 * 1e-6)


@dataclass(frozen=True, eq=False)
class RecordingFrames:
    """Frames of a recording."""

    counts: NDArray[Any]
    """(n, rows, columns)"""
    codes: NDArray[Any] | None
    """Codes of the ADC, if recorded."""
    exposure_s: float
    sensor: Sensor | None
    """Nominal sensor."""
    times_s: Floats
    """Start of each exposure; consecutive if not recorded."""
    is_binary: bool = False
    """True if counts are bits."""


def read_recorded(source: Source) -> RecordingFrames:
    """Read a recording.

    Raises UserError if there is none, it is damaged, or its exposure is unknown.
    """
    with refused_as("", OSError):
        recorded = _captured(source) if is_recording(source.path) else _of_others(source)
    if source.frames is None:
        return recorded
    first, end = source.frames
    if end > len(recorded.counts):
        raise UserError(
            f"{source.path}: frames {first} to {end - 1}; it has {len(recorded.counts)}"
        )
    codes = None if recorded.codes is None else recorded.codes[first:end]
    return replace(
        recorded,
        counts=recorded.counts[first:end],
        codes=codes,
        times_s=recorded.times_s[first:end],
    )


def _captured(source: Source) -> RecordingFrames:
    recording = open_recording(source.path)
    times_s = recording.times_s - recording.exposure_s
    return RecordingFrames(
        recording.counts[:], recording.adc, recording.exposure_s, recording.sensor, times_s
    )


def _of_others(source: Source) -> RecordingFrames:
    frames = read_frames(source.path, source.kind)
    exposure = source.exposure_s or frames.exposure_s
    if exposure is None:
        raise ValueError(
            f"{source.path}: exposure is unknown; give {source.path}@LIGHT:SECONDS, or in a list "
            "exposure_s"
        )
    if frames.counts.ndim != 3:
        raise ValueError(f"{source.path}: {frames.counts.ndim} dimensions; give gray frames")
    times_s = exposure * np.arange(len(frames.counts), dtype=np.float64)
    return RecordingFrames(frames.counts, None, exposure, None, times_s, frames.bit_depth == 1)
