"""Recordings to calibrate from or to compare, as named on the command line or in a list.

A recording is named RECORDING, RECORDING@LIGHT or RECORDING@LIGHT:EXPOSURE_S, is one of a folder
or of a YAML list (`docs/how-to/calibrate.md`). Its `recording.yaml` has the keys of a list without
`path`. What is not stated there is taken from the file's header, else from the names of the
recording, of its first file and of its folder (`megalopta.sensor.formats.conditions`).
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.camera.recording import SETTINGS, is_recording, open_recording
from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.bounded import read_text
from megalopta.core.errors import UserError, refused_as
from megalopta.core.files import natural_key
from megalopta.core.progress import say, silent
from megalopta.core.quantities import with_error
from megalopta.core.record import Record
from megalopta.core.validation import checked
from megalopta.sensor import Sensor
from megalopta.sensor.formats.conditions import conditions_in
from megalopta.sensor.formats.packed import Layout
from megalopta.sensor.formats.reading import FrameKind, read_frames
from megalopta.sensor.formats.recorded_frames import (
    ZEROS_AND_ONES,
    RecordedFrames,
    Stack,
    Values,
    parts_in,
)
from megalopta.sensor.optics import PLANCK_TIMES_LIGHT_SPEED


class Statement(Record, frozen=True):
    """Statements about a recording: content of its recording.yaml."""

    exposure_s: Annotated[float, Field(gt=0)] | None = None
    """Exposure of a frame (s); null: that of the file, or of its name."""
    light: Annotated[float, Field(ge=0)] = 0.0
    """Photons per second and pixel, or watts of the beam; 0: dark. Default: that of the file, or of
    its name, else dark."""
    format: FrameKind | None = None
    """Format of another camera's file; null: by its content."""
    layout: Layout | None = None
    """Layout of raw frames."""
    variable: str | None = None
    """Array of a .mat or HDF5 file; null: the only one."""
    values: Values | None = None
    """counts or bits; null: by type and values."""
    frames: tuple[Annotated[int, Field(ge=0)], int] | None = None
    """First frame, and the frame after the last; null: all."""
    sums: Annotated[int, Field(ge=2)] | None = None
    """Binary frames that each frame of the file is the sum of. `exposure_s` is that of one."""


class Source(Statement, frozen=True):
    """A recording and its light: an entry of a list."""

    path: Path
    """File or folder."""
    _contradictions: str = ""

    @property
    def contradictions(self) -> str:
        """Sentences on statements that contradict those that are taken."""
        return self._contradictions

    def read(self, frames: slice, shape: tuple[int, int] | None = None) -> RecordedFrames:
        """Read consecutive frames; as `read_frames`."""
        if is_recording(self.path):
            recording = open_recording(self.path)
            stated = {"exposure_s": recording.exposure_s} | (
                {"light": 0.0} if recording.kind == "dark" else {}
            )
            stack = Stack("SPADCAM", len(recording), 512, recording.counts.__getitem__, 16, stated)
            return stack.frames(self.path, frames)
        return read_frames(
            self.path, self.format, shape=shape, frames=frames, values=self.values,
            variable=self.variable, layout=self.layout,
        )  # fmt: skip


class _List(Record, frozen=True):
    recordings: Annotated[tuple[Source, ...], Field(min_length=1)]
    """Recordings of one camera."""


def named_sources(words: Sequence[str], kind: FrameKind | None = None) -> list[Source]:
    """Return the recordings of RECORDING@LIGHT:EXPOSURE_S, of folders, or of one .yaml list.

    A line says what each is, and where its exposure and light are from. `kind` is the format of
    those named. Raises UserError, also if an exposure, or the light of one in a folder, is
    unknown.
    """
    named, inside = list[Source](), set[Path]()
    if len(words) == 1 and words[0].endswith((".yaml", ".yml")):
        path = Path(words[0])
        listed = _read_yaml(_List, path).recordings
        named = [entry.model_copy(update={"path": path.parent / entry.path}) for entry in listed]
        words = ()
    for word in words:
        source = named_source(word, kind)
        with refused_as(repr(word)):
            is_alone = source.model_fields_set & {"light", "exposure_s"}
            paths = [] if is_alone else recordings_in(source.path)
        inside.update(paths)
        named += [source.model_copy(update={"path": path}) for path in paths or [source.path]]
    known = [look_at(source) for source in named]
    are_bits, sources = all(first.values == "bits" for _, first, _ in known), []
    for source, first, conditions in known:
        path, values, basis = source.path, first.values, first.basis
        if basis == ZEROS_AND_ONES and (source.sums or not are_bits):  # counts of little light
            values, basis = "counts", "as the others"
            source = source.model_copy(update={"values": values})
        rows, columns = first.counts.shape[1:3]
        size = f"{first.total} frames × {rows} rows × {columns} columns"
        say(f"{path.name}: {first.source}, {size}, {values} ({basis}); {conditions}")
        how = (
            f"give {path}@LIGHT:SECONDS (dark: @0:SECONDS), state it in a list or its {SETTINGS}, "
        )
        how += "or name it such as"
        if not source.exposure_s:
            raise UserError(f"{path}: exposure is unknown; {how} {path.stem}_10us")
        if path in inside and "light" not in source.model_fields_set:
            raise UserError(f"{path}: light is unknown; {how} dark_10us or flat_2e7_10us")
        sources.append(source)
    return sources


def named_source(word: str, kind: FrameKind | None = None) -> Source:
    """Return what RECORDING@LIGHT:SECONDS, or the path of a recording, names. Raises UserError."""
    name, at, numbers = (word, "", "") if Path(word).exists() else word.partition("@")
    if not at and ":" in Path(name).name and not Path(name).exists():
        raise UserError(f"{word!r}: give RECORDING@LIGHT:SECONDS, in the dark @0:SECONDS")
    light, _, exposure_s = numbers.partition(":")
    fields: dict[str, Any] = {"format": kind, "path": Path(name)}
    try:
        fields |= {"light": float(light)} if light else {}
        fields |= {"exposure_s": float(exposure_s)} if exposure_s else {}
    except ValueError:
        raise UserError(f"{word!r}: give RECORDING@LIGHT:SECONDS, such as @2e7:1e-5") from None
    with refused_as(repr(word)):
        return checked(Source, fields)


_PARTS = (".png", ".tif", ".tiff", ".bin", ".raw")
"""Suffixes of files that may be a part of a recording"""
_STACKS = (".npy", ".mat", ".h5", ".hdf5", ".spc3")


def recordings_in(folder: Path) -> list[Path]:
    """Return the recordings of a folder, in natural order; none if it is one recording itself.

    It is one if it holds pictures or raw files whose names differ in numbers alone that state no
    exposure or light. Raises ValueError for pictures of several recordings, and for links.
    """
    if not folder.is_dir() or is_recording(folder):
        return []
    entries = sorted((path for path in folder.iterdir() if path.name[0] != "."), key=natural_key)
    if links := [path for path in entries if path.is_symlink()]:
        raise ValueError(f"{links[0]}: a link in a folder of recordings; remove it")
    parts = [path for path in entries if path.suffix.lower() in _PARTS]
    series = {(re.sub("[0-9]+", "", path.stem), *conditions_in(path.stem, True)) for path in parts}
    folders = [path for path in entries if path.is_dir()]
    recordings = [path for path in folders if is_recording(path) or parts_in(path, *_PARTS)]
    recordings += [path for path in entries if path.suffix.lower() in _STACKS]
    if recordings or (len(series) > 1 and {text for text, *_ in series} != {"top", "btm"}):
        recordings += [path for path in parts if path.suffix.lower() != ".png"]
        if not recordings:
            names = f"{parts[0].name}, {parts[-1].name}"
            raise ValueError(f"pictures of several recordings, {names}; put each into a folder")
    return sorted(recordings, key=natural_key)


def _read_yaml(model: type[Record], path: Path) -> Any:
    if path.is_symlink():
        raise UserError(f"{path}: a link; give the file itself")
    try:
        with refused_as(str(path)):
            return checked(model, strict_yaml.load(read_text(path, 2**20)))
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error.strerror}); give a YAML file") from None


def _stated(record: Statement) -> dict[str, Any]:
    names = record.model_fields_set
    return {name: value for name, value in record if name in names and value is not None}


def look_at(source: Source) -> tuple[Source, RecordedFrames, str]:
    """Return a recording with what its recording.yaml, header and names state, and its first frame.

    The text tells exposure and light, and where they are from; a line says where statements
    contradict each other. Raises UserError if there is none, or it is damaged.
    """
    path, listed, beside = source.path, _stated(source), dict[str, Any]()
    for settings in (path.parent / SETTINGS, path / SETTINGS):
        if settings.exists() and not is_recording(settings.parent):
            beside |= _stated(_read_yaml(Statement, settings))
    source = source.model_copy(update=beside | listed)
    with refused_as("", OSError):
        first = source.read(slice(0, 1))
        parts = parts_in(path, *_PARTS) if path.is_dir() else []
    statements: dict[str, Mapping[str, Any]] = {
        "stated": listed,
        SETTINGS: beside,
        "header": first.conditions,
        "name": conditions_in(path.name, is_name=True),
        "file's name": conditions_in(parts[0].name, is_name=True) if parts else {},
    }
    origins = dict[str, str]()
    for (place, stated), quantity in product(statements.items(), ("exposure_s", "light")):
        if quantity in stated:
            origin = origins.setdefault(quantity, place)
            former, value = stated[quantity], statements[origin][quantity]
            if not math.isclose(former, value, rel_tol=0.01):
                contradiction = f"{quantity} {former:g} ({place}) contradicts {value:g} ({origin})"
                source._contradictions += f" {path.name}: {contradiction}, which is taken."
                say(f"{path}: {contradiction}, which is taken")
    chosen = {quantity: statements[origin][quantity] for quantity, origin in origins.items()}
    exposure_s, light = chosen.get("exposure_s"), chosen.get("light")
    of_sum = f"each a sum of {source.sums} binary frames; of one, " if source.sums else ""
    conditions = (
        f"{of_sum}exposure {with_error(exposure_s, math.nan, 's') if exposure_s else 'unknown'} "
        f"({origins.get('exposure_s', 'not stated')}), "
        f"{f'light {light:.4g}' if light else 'dark'} ({origins.get('light', 'not stated')})"
    )
    return source.model_copy(update=chosen), first, conditions


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
            meant = [f", such as {nm * by:g}" for by in (1e3, 1e9) if first <= nm * by <= last]
            raise ValueError(
                f"--wavelength-nm {nm:g}: the device's efficiency is known from {first:g} to "
                f"{last:g} nm; give the wavelength of the light in nanometers{''.join(meant)}"
            )
        if self.area_mm2 is None:
            return light
        of_beam_hz = light * nm * 1e-9 / PLANCK_TIMES_LIGHT_SPEED
        return of_beam_hz * sensor.pitch_m**2 / (self.area_mm2 * 1e-6)


@dataclass(frozen=True, eq=False)
class RecordingFrames:
    """Frames of a recording."""

    counts: NDArray[Any]
    """(n, rows, columns)"""
    exposure_s: float
    """Of a frame: for sums, of all its binary frames"""
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
    codes, sensor = None, None
    part = slice(*source.frames) if source.frames else slice(None)
    with refused_as("", OSError):
        if source.frames and not source.frames[0] < source.frames[1]:
            raise ValueError(
                f"{source.path}: frames {source.frames}; give the first and a later one"
            )
        stored = source.read(part)
        if stored.counts.ndim != 3:
            raise ValueError(f"{source.path}: {stored.counts.ndim} dimensions; give gray frames")
        if source.sums and (stored.values == "bits" or is_recording(source.path)):
            raise ValueError(f"{source.path}: sums: are of counts, not of bits or codes; omit it")
        exposure_s = (source.exposure_s or stored.exposure_s or 0.0) * (source.sums or 1)
        times_s = exposure_s * np.arange(len(stored.counts), dtype=np.float64)
        if is_recording(source.path):
            with silent():  # it has said what is missing
                recording = open_recording(source.path)
            codes, sensor = recording.adc[part], recording.settings.sensor
            exposure_s = recording.exposure_s
            times_s = recording.times_s[part] - exposure_s
    is_binary = stored.values == "bits"
    return RecordingFrames(stored.counts, exposure_s, times_s, codes, sensor, is_binary)
