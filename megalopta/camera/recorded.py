"""Recordings as they are named on the command line: RECORDING or RECORDING@LIGHT.

A recording is a folder that `megalopta spadcam capture` wrote, or another camera's file of counts
(`megalopta.sensor.formats`), whose exposure then follows: FILE@LIGHT:EXPOSURE_S. Where one holds
several lights, each is a range of its frames: RECORDING#0-100@LIGHT.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.recording import open_recording
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.sensor import Sensor
from megalopta.sensor.formats.reading import FrameKind, read_frames

_PLANCK_TIMES_C = 1.98644586e-25


@dataclass(frozen=True)
class Source:
    """A recording and the light in it."""

    path: Path
    light: float = 0.0
    """As given: photons per second on a pixel, or watts of the beam; 0: in the dark."""
    exposure_s: float | None = None
    frames: tuple[int, int] | None = None
    """First frame, and the one after the last; none: all."""
    kind: FrameKind | None = None
    """Format of another camera's file; none: as its content says, counts or bits of .npy by their
    type."""

    @classmethod
    def parse(cls, text: str, kind: FrameKind | None = None) -> "Source":
        """Parse RECORDING, RECORDING@LIGHT or RECORDING#FIRST-END@LIGHT:EXPOSURE_S.

        Raises UserError when light or exposure is no number, or negative, or a range of frames is
        none.
        """
        name, _, numbers = text.partition("@")
        path, _, range_ = name.partition("#")
        light, _, exposure = numbers.partition(":")
        try:
            values = float(light or 0), float(exposure) if exposure else None
        except ValueError:
            raise UserError(f"{text!r}: give RECORDING@LIGHT, a number after the @") from None
        if not 0 <= values[0] < np.inf or (values[1] is not None and not 0 < values[1] < np.inf):
            raise UserError(f"{text!r}: light or exposure is impossible; give positive numbers")
        return cls(Path(path), *values, _range(range_, text), kind)


def _range(text: str, source: str) -> tuple[int, int] | None:
    if not text:
        return None
    first, _, end = text.partition("-")
    if not (first.isdecimal() and end.isdecimal() and int(first) < int(end)):
        raise UserError(f"{source!r}: give RECORDING#FIRST-END, such as #0-100 for 100 frames")
    return int(first), int(end)


@dataclass(frozen=True)
class Beam:
    """Light of flat frames, where it is known as a beam's power."""

    wavelength_nm: float | None = None
    area_mm2: float | None = None
    """None: light is given as photons per second on a pixel."""

    def photons_hz(self, light: float, sensor: Sensor) -> float:
        """Photons per second on a pixel; relative where the wavelength is not known."""
        if self.area_mm2 is None or self.wavelength_nm is None:
            return light
        photons_hz = light * self.wavelength_nm * 1e-9 / _PLANCK_TIMES_C
        return photons_hz * sensor.pitch_m**2 / (self.area_mm2 * 1e-6)


@dataclass(frozen=True, eq=False)
class Recorded:
    """Frames of a recording."""

    counts: NDArray[Any]
    """(n, rows, columns)"""
    codes: NDArray[Any] | None
    """Of the ADC, where they are recorded."""
    exposure_s: float
    sensor: Sensor | None
    """The nominal one."""
    times_s: Floats
    """When each exposure began; one after the other where it is not recorded."""

    def at(self, frames: tuple[int, int] | None) -> "Recorded":
        """Keep a range of the frames. Raises ValueError when there are fewer."""
        if frames is None:
            return self
        if frames[1] > len(self.counts):
            raise ValueError(f"frames {frames[0]} to {frames[1] - 1}; it has {len(self.counts)}")
        part = slice(*frames)
        codes = None if self.codes is None else self.codes[part]
        return replace(self, counts=self.counts[part], codes=codes, times_s=self.times_s[part])


def read_recorded(source: Source) -> Recorded:
    """Read a recording.

    Raises UserError when there is none, it is damaged, or its exposure is not known.
    """
    try:
        is_captured = any((source.path / each).exists() for each in ("counts.zarr", "raw.bin"))
        recorded = _captured(source) if is_captured else _of_others(source)
    except (ValueError, OSError) as problem:
        raise UserError(str(problem)) from problem
    try:
        return recorded.at(source.frames)
    except ValueError as problem:
        raise UserError(f"{source.path}: {problem}") from None


def _captured(source: Source) -> Recorded:
    recording = open_recording(source.path)
    codes = np.asarray(recording.adc[:])
    times_s = recording.times_s - recording.exposure_s
    return Recorded(recording.counts[:], codes, recording.exposure_s, recording.sensor, times_s)


def _of_others(source: Source) -> Recorded:
    frames = read_frames(source.path, source.kind)
    exposure = source.exposure_s or frames.exposure_s
    if exposure is None:
        raise ValueError(f"{source.path}: it says no exposure; give {source.path}@LIGHT:SECONDS")
    if frames.counts.ndim != 3:
        raise ValueError(f"{source.path}: {frames.counts.ndim} dimensions; give gray frames")
    times_s = exposure * np.arange(len(frames.counts), dtype=np.float64)
    return Recorded(frames.counts, None, exposure, None, times_s)
