"""Recordings to calibrate from or to compare, as named on the command line or in a list.

A recording is named RECORDING or RECORDING@LIGHT; another camera's file of counts
(`megalopta.sensor.formats`) is FILE@LIGHT:EXPOSURE_S. A list is YAML, with paths relative to it:

    recordings:
      - {path: dark.npy, exposure_s: 1.0e-3}
      - {path: flat, exposure_s: 1.0e-5, light: 2.0e7, format: swissspad2, frames: [0, 1000]}
      - {path: 8-bit.npy, exposure_s: 1.0e-5, light: 2.0e7, sums: 255}
"""

from collections.abc import Sequence
from dataclasses import dataclass
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

_PLANCK_TIMES_C = 1.98644586e-25
"""J·m"""


class Source(Record, frozen=True):
    """A recording and its light: an entry of a list."""

    path: Path
    """File or folder."""
    exposure_s: Annotated[float, Field(gt=0)] | None = None
    """Exposure of a frame (s); null: that of the file."""
    light: Annotated[float, Field(ge=0)] = 0.0
    """Photons per second and pixel, or watts of the beam; 0: dark."""
    format: FrameKind | None = None
    """Format of another camera's file; null: by its content, counts or bits of .npy by their type.
    """
    frames: tuple[Annotated[int, Field(ge=0)], int] | None = None
    """First frame, and the frame after the last; null: all."""
    sums: Annotated[int, Field(ge=2)] | None = None
    """Binary frames that each frame of the file is the sum of. `exposure_s` is that of one."""


class _List(Record, frozen=True):
    recordings: Annotated[tuple[Source, ...], Field(min_length=1)]
    """Recordings of one camera."""


def named_sources(words: Sequence[str], kind: FrameKind | None = None) -> list[Source]:
    """Return the recordings of RECORDING@LIGHT:EXPOSURE_S, or of one .yaml list.

    `kind` is the format of those in words. Raises UserError.
    """
    if len(words) == 1 and words[0].endswith((".yaml", ".yml")):
        path = Path(words[0])
        try:
            with refused_as(str(path)):
                listed = checked(_List, strict_yaml.load(read_text(path, 2**20))).recordings
        except OSError as error:
            raise UserError(
                f"{path} cannot be read ({error.strerror}); give a YAML list of recordings"
            ) from None
        return [entry.model_copy(update={"path": path.parent / entry.path}) for entry in listed]
    named = []
    for word in words:
        name, at, numbers = word.partition("@")
        if not at and ":" in Path(name).name and not Path(name).exists():
            raise UserError(f"{word!r}: give RECORDING@LIGHT:EXPOSURE_S, in the dark @0:EXPOSURE_S")
        light, _, exposure_s = numbers.partition(":")
        fields: dict[str, Any] = {"path": Path(name), "format": kind}
        try:
            fields |= {"light": float(light)} if light else {}
            fields |= {"exposure_s": float(exposure_s)} if exposure_s else {}
        except ValueError:
            raise UserError(f"{word!r}: give RECORDING@LIGHT, with a number after the @") from None
        with refused_as(repr(word)):
            named.append(checked(Source, fields))
    return named


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
        if nm is None and self.area_mm2 is not None:
            raise ValueError("--beam-area-mm2: give --wavelength-nm too, which makes it photons")
        if nm is None:
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
    exposure_s: float
    times_s: Floats
    """Start of each exposure; consecutive if not recorded."""
    codes: NDArray[Any] | None = None
    """Codes of the ADC, if recorded."""
    sensor: Sensor | None = None
    """Nominal sensor."""
    is_binary: bool = False
    """True if counts are bits."""


def read_recorded(source: Source) -> RecordingFrames:
    """Read a recording.

    Raises UserError if there is none, it is damaged, or its exposure is unknown.
    """
    codes, sensor, is_binary = None, None, False
    with refused_as("", OSError):
        if is_recording(source.path):
            recording = open_recording(source.path)
            counts, codes = recording.counts[:], recording.adc
            exposure_s, sensor = recording.exposure_s, recording.settings.sensor
            times_s = recording.times_s - exposure_s
        else:
            stored = read_frames(source.path, source.format)
            counts, is_binary = stored.counts, stored.bit_depth == 1
            if counts.ndim != 3:
                raise ValueError(f"{source.path}: {counts.ndim} dimensions; give gray frames")
            if not (exposure_s := source.exposure_s or stored.exposure_s or 0.0):
                raise ValueError(
                    f"{source.path}: exposure is unknown; give {source.path}@LIGHT:SECONDS, or in "
                    "a list exposure_s"
                )
            times_s = exposure_s * np.arange(len(counts), dtype=np.float64)
    first, end = source.frames or (0, len(counts))
    if source.frames and not first < end <= len(counts):
        raise UserError(
            f"{source.path}: frames [{first}, {end}]; give the first and a later one, at most "
            f"{len(counts)}"
        )
    part = slice(first, end)
    codes = None if codes is None else codes[part]
    return RecordingFrames(counts[part], exposure_s, times_s[part], codes, sensor, is_binary)
