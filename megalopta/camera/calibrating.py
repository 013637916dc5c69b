"""`megalopta spadcam calibrate`: recordings by name, or from a list, to a device file.

    recordings:
      - {path: dark.npy, exposure_s: 1.0e-3}
      - {path: flat, exposure_s: 1.0e-5, light: 2.0e7, format: swissspad2, frames: [0, 1000]}
      - {path: 8-bit.npy, exposure_s: 1.0e-5, light: 2.0e7, sums: 255}

Paths are relative to the list. Codes of SPADCAM give all its parameters (`calibration`); counts and
bits of other cameras give dark counts, efficiency, dead time and bad pixels (`counting`).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field

from megalopta.camera.calibration import calibrate_codes
from megalopta.camera.counting import calibrate_counting
from megalopta.camera.recording import Beam, Source, is_recording
from megalopta.core import strict_yaml
from megalopta.core.bounded import read_text
from megalopta.core.errors import UserError, refused_as
from megalopta.core.record import Record
from megalopta.core.validation import checked
from megalopta.sensor.formats.reading import FrameKind

_LIST_BYTES = 2**20


class ListedRecording(Record, frozen=True):
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


class RecordingList(Record, frozen=True):
    """Recordings of one camera."""

    recordings: Annotated[tuple[ListedRecording, ...], Field(min_length=1)]


def listed_sources(path: Path) -> list[Source]:
    """Read a list of recordings. Raises UserError."""
    try:
        found = checked(RecordingList, strict_yaml.load(read_text(path, _LIST_BYTES)))
    except OSError as error:
        raise UserError(
            f"{path} cannot be read ({error.strerror}); give a YAML list of recordings"
        ) from None
    except ValueError as error:
        raise UserError(f"{path}: {error}") from None
    for each in found.recordings:
        if each.frames is not None and each.frames[1] <= each.frames[0]:
            raise UserError(f"{path}: frames {list(each.frames)}; give the first and a later one")
    return [
        Source(
            path.parent / each.path,
            each.light,
            each.exposure_s,
            each.frames,
            each.format,
            each.sums,
        )
        for each in found.recordings
    ]


def named_sources(words: Sequence[str]) -> list[Source]:
    """Return the recordings of RECORDING@LIGHT, or of one .yaml list. Raises UserError."""
    if len(words) == 1 and words[0].endswith((".yaml", ".yml")):
        return listed_sources(Path(words[0]))
    return [Source.parse(text) for text in words]


def calibrate_recordings(
    sources: Sequence[Source], out: Path, *, beam: Beam, base: str = "spadcam"
) -> str:
    """Write a device file, its maps and its report; return a summary in a sentence.

    Raises UserError if a recording cannot be read, or all of them do not suffice for a calibration.
    """
    if out.suffix not in (".yaml", ".yml"):
        raise UserError(f"--out {out}: give the name of a .yaml file")
    if beam.area_mm2 is not None and beam.wavelength_nm is None:
        raise UserError("--beam-area-mm2: give --wavelength-nm too, to convert watts to photons")
    kinds = {is_recording(source.path) for source in sources}
    if len(kinds) > 1:
        raise UserError("calibrate: recordings of SPADCAM and of others; give those of one camera")
    if True in kinds and any(source.sums for source in sources):
        raise UserError("sums: of recordings of SPADCAM; omit it, or give a file of sums")
    calibrate = calibrate_codes if True in kinds else calibrate_counting
    with refused_as("calibrate"):
        return calibrate(sources, out, beam, base)
