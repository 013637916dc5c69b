"""Readings of any sensor as they are shown, read on demand: of a dataset, recording or file."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.recording import SETTINGS, is_recording, open_recording
from megalopta.camera.sources import Source, look_at, named_source
from megalopta.core import bounded
from megalopta.core.arrays import Floats, Mask
from megalopta.core.errors import UserError, near_path, refused_as, shell_command
from megalopta.dataset.opened import open_dataset
from megalopta.render import is_footage
from megalopta.sensor import ImageSensor, Sensor, read_events
from megalopta.sensor.calibrate.correction import ResponseCurve, filled_in, response_curve
from megalopta.sensor.formats.events import HDF5_SIGNATURE
from megalopta.sensor.formats.reading import FrameKind
from megalopta.sensor.formats.recorded_frames import file_bytes
from megalopta.sensor.quantities import histogram
from megalopta.stages.sense import burst_frames

_ARRAYS = (".npy", ".npz", ".tif", ".tiff")
"""Suffixes of files that hold readings, or pictures"""


@dataclass(frozen=True, eq=False)
class Treatment:
    """Treatment of readings before they are shown."""

    summed: int = 1
    """Frames that are added up"""
    is_inverted: bool = False
    """True to invert the sensor's response: readings become mean detections per frame"""
    bad: Mask | None = None
    """(H, W): pixels that take the mean of their good neighbors"""

    def description(self) -> str:
        """Return what was done, in sentences; nothing where nothing was."""
        sentences = []
        if self.is_inverted:
            sentences.append(
                "The sensor's response is inverted: gray is the mean number of detections in a "
                "frame if none were lost, dark counts included; saturated pixels are orange."
            )
        if self.bad is not None:
            sentences.append(f"{self.bad.sum()} bad pixels are the mean of their good neighbors.")
        return " ".join(sentences)


@dataclass(frozen=True, eq=False)
class ShownReadings:
    """Readings of a sensor, a few frames at a time."""

    shape: tuple[int, ...]
    """Frames, rows, columns, and colors where there are three"""
    read: Callable[[slice], tuple[NDArray[Any], NDArray[np.bool_]]]
    """Reads a range of frames: readings and saturation, each of `shape`"""
    unit: str = "counts"
    sensor: ImageSensor | None = None
    """Where it is known"""
    bits: int = 0
    """Binary frames in each: 1 of bits, more of sums, 0 of counts"""
    times_s: Floats | None = None
    """Time of each frame, s, where it is known"""
    treatment: Treatment = field(default_factory=Treatment)

    def treated(self, treatment: Treatment) -> "ShownReadings":
        """Return these readings as they are to be shown. Raises UserError where they cannot be."""
        frames, rows, columns = self.shape[:3]
        if treatment.summed > frames:
            raise UserError(
                f"--sum {treatment.summed}: there are {frames} frames; give that or less"
            )
        if treatment.bad is not None and treatment.bad.shape != (rows, columns):
            raise UserError(
                f"--bad-pixels: a mask of {treatment.bad.shape[1]} × {treatment.bad.shape[0]} "
                f"pixels, but frames have {columns} × {rows}; give one of their size"
            )
        if treatment.is_inverted and self.bits * treatment.summed == 1:
            raise UserError("--invert: one binary frame does not determine the flux; add --sum 64")
        if treatment.is_inverted and not (self.bits or isinstance(self.sensor, Sensor)):
            raise UserError(
                "--invert: the response of this sensor is not known; omit it, or give binary "
                "frames, a recording, or a dataset of a SPAD array"
            )
        return replace(self, treatment=treatment)

    def frame(self, number: int) -> tuple[Floats, Mask]:
        """Return what is shown from a frame on, and which were saturated, (H, W) or (H, W, 3)."""
        summed, is_inverted = self.treatment.summed, self.treatment.is_inverted
        values, is_full = np.zeros(self.shape[1:]), np.zeros(self.shape[1:], np.bool_)
        end, most = number + summed, max(1, 2**23 // math.prod(self.shape[1:]))  # readings at once
        for first in range(number, end, most):
            counts, full = self.read(slice(first, min(first + most, end)))
            if is_inverted and not self.bits:
                full = full | (counts > self._curve.largest)
                counts = self._curve.arrivals_of(counts.astype(np.float64))
            values += counts.sum(axis=0, dtype=np.float64)
            is_full |= full.any(axis=0)
        if is_inverted:
            values /= summed * max(self.bits, 1)
        if is_inverted and self.bits:
            # a share e⁻ᶠ of the frames has no detection, where there are f on average
            most_share = 1 - 0.5 / (summed * self.bits)
            is_full = values > most_share
            values = -np.log1p(-np.minimum(values, most_share))
        if (bad := self.treatment.bad) is None:
            return values, is_full
        colors = np.moveaxis(np.atleast_3d(values), -1, 0)
        filled, _ = filled_in(colors, np.zeros_like(colors), bad)
        is_full &= ~bad if values.ndim == 2 else ~bad[..., np.newaxis]
        return np.moveaxis(filled, 0, -1).reshape(values.shape), is_full

    @cached_property
    def _curve(self) -> ResponseCurve:
        assert isinstance(self.sensor, Sensor)
        with refused_as("--invert"):
            return response_curve(self.sensor)


def readings_of(path: Path, kind: FrameKind | None = None) -> ShownReadings:
    """Return the readings of a recording, or of a file or folder of frames or events.

    Raises UserError where there are none, or they are damaged.
    """
    source = named_source(str(path), kind)
    path = source.path
    is_array = path.suffix.lower() in _ARRAYS or any(path.glob("*.bin")) or _is_stated(path, kind)
    if not (is_array or is_recording(path)) and path.exists() and is_footage(path):
        sense = shell_command("sense", path, "--photons", "2")
        raise UserError(
            f"{path}: pictures, no readings; make photons of them first: {sense}; of a camera's "
            "counts, give --format png or tiff"
        )
    if not (is_array or is_recording(path) or path.is_file()):
        near = near_path(path, "give one")
        raise UserError(f"{path}: no dataset, recording, or file of frames or events; {near}")
    with refused_as("", OSError):
        if is_recording(path):
            recording = open_recording(path)
            counts, full = recording.counts, recording.saturated
            return ShownReadings(
                recording.adc.shape,
                lambda part: (counts[part], full[part]),
                sensor=recording.settings.sensor,
                times_s=recording.times_s - recording.exposure_s,
            )
        if not kind and path.is_file() and file_bytes(path)[:8].tobytes() == HDF5_SIGNATURE:
            return _of_events(path)
        root = path.absolute().parent.parent.parent
        of_dataset = path.name.endswith((".burst.npy", ".binary.npy"))
        if of_dataset and (root / "dataset.yaml").exists():
            settings = open_dataset(root)[path.parent.name].configuration
            in_frame = burst_frames(settings) if ".burst" in path.suffixes else 1
            rate_hz = in_frame * settings.trajectory.frame_rate_hz
            return _of_frames(source, settings.camera.shape, rate_hz)
        return _of_frames(look_at(source)[0])


def _is_stated(path: Path, kind: FrameKind | None) -> bool:
    """True for a folder of pictures that are frames, as somebody states, or their bits tell."""
    if not path.is_dir():
        return False
    if kind or any((folder / SETTINGS).exists() for folder in (path, path.parent)):
        return True
    try:
        return look_at(Source(path=path))[1].values == "bits"
    except UserError as problem:
        if type(problem.__cause__) is ValueError:  # frames of two sizes, or links
            raise
        return False


def read_mask(path: Path) -> Mask:
    """Return the mask of bad pixels of a .npy file, true where bad, (H, W). Raises UserError."""
    with refused_as():
        mask = bounded.plain_array(bounded.file_content(path, "--bad-pixels"), "b")
    if mask is None or mask.ndim != 2 or mask.all():
        raise UserError(
            f"--bad-pixels: {path} is no mask; give bool (rows, columns), true where a pixel is bad"
        )
    return mask


def _of_frames(
    source: Source, size: tuple[int, int] | None = None, rate_hz: float | None = None
) -> ShownReadings:
    """Return frames of this size and rate, which a file may state itself."""
    first, path = source.read(slice(0, 1), size), source.path
    shape, bits = first.counts.shape[1:], int(first.bit_depth == 1) or source.sums or 0
    if len(shape) > 2 and shape[2] != 3:
        raise ValueError(f"{path}: {shape[2]} colors of a pixel; give gray frames, or three")
    bounded.check_decoded(path, shape, 40)  # bytes of a reading while its frame is drawn
    stated = source.model_copy(update={"format": first.source, "values": first.values})
    stack = stated.read(slice(None)).counts if first.source == "tiff" and path.is_file() else None

    def read(part: slice) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        counts = stated.read(part, size).counts if stack is None else stack[part]
        return counts, np.zeros(counts.shape, np.bool_)

    times_s = None
    if period_s := 1 / rate_hz if rate_hz else (source.exposure_s or 0.0) * max(bits, 1):
        times_s = period_s * np.arange(first.total, dtype=np.float64)
    unit = "detections" if bits else "counts"
    return ShownReadings((first.total, *shape), read, unit, bits=bits, times_s=times_s)


def _of_events(path: Path) -> ShownReadings:
    stored = read_events(path)
    events, origin = stored.events, stored.origin

    def read(part: slice) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        counts = histogram(events, part)
        return counts, np.zeros(counts.shape, np.bool_)

    frames = origin.first_frame + np.arange(origin.shape[0], dtype=np.float64)
    return ShownReadings(origin.shape, read, "events", times_s=frames * origin.frame_period_s)
