"""Camera on a recorded path, a CSV file: cubic spline, and spherical linear interpolation."""

import math
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, ValidationInfo, model_validator
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.core.bounded import check_count, folder_of, named_path, read_text, unreadable
from megalopta.scenes.trajectories.base import Path

COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
_MOST_LINES, _LARGEST = 200_000, 1e12


def recorded_text(source: object, validation: ValidationInfo) -> object:
    """Text of a CSV file, given its path or the text itself."""
    if not isinstance(source, str) or "\n" in source:
        return source
    path = named_path(source, folder_of(validation))
    try:
        with unreadable(source):
            text = read_text(path.expanduser()) + "\n"
        read_recording(text)
    except UnicodeDecodeError:
        raise ValueError(f"{source} is not a UTF-8 text file; give a CSV file") from None
    except ValueError as problem:
        raise ValueError(f"{source}: {problem}") from None
    return text


class Recorded(Path, frozen=True):
    """Six degrees of freedom from a file, whose content becomes part of the configuration."""

    kind: Literal["recorded"] = "recorded"
    csv: Annotated[str, BeforeValidator(recorded_text)]
    """Path of a CSV file with the columns t (s), x, y, z (m) and qx, qy, qz, qw (unit quaternion
    from camera axes, +x right, +y down, +z forward, to world axes); a header line is optional. It
    is read once; from then on this is the file's text."""

    @model_validator(mode="after")
    def _recording_lasts(self) -> "Recorded":
        lasts = float(np.ptp(read_recording(self.csv)[:, 0]))
        needed = (self.frames - 1) / self.frame_rate_hz
        if needed > lasts * (1 + 1e-9):
            most = math.floor(lasts * self.frame_rate_hz * (1 + 1e-9)) + 1
            raise ValueError(
                f"csv: the recording lasts {lasts:g} s, but the frames are taken from 0 to "
                f"{needed:g} s: use at most {most} frames"
            )
        return self

    def course(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Positions (n, 3), m, and rotations (n, 3, 3), camera axes to world.

        Shortly before and after the recording the motion is extrapolated.
        """
        recording = read_recording(self.csv)
        knots = recording[:, 0] - recording[0, 0]
        turns = Rotation.from_quat(recording[:, 4:])
        first = np.clip(np.searchsorted(knots, times_s, side="right") - 1, 0, len(knots) - 2)
        part = (times_s - knots[first]) / np.diff(knots)[first]
        steps = (turns[:-1].inv() * turns[1:]).as_rotvec()
        rotations = turns[first] * Rotation.from_rotvec(part[:, None] * steps[first])
        return CubicSpline(knots, recording[:, 1:4])(times_s), rotations.as_matrix()

    def __str__(self) -> str:
        """Camera motion."""
        return "follows a recorded path"


@lru_cache(maxsize=4)
def read_recording(text: str) -> Floats:
    """Read a recording (n, 8) from the text of its CSV file; columns as in COLUMNS.

    Raises ValueError with the first invalid line and the reason.
    """
    check_count("a recorded path", "lines", text.count("\n") + text.count("\r"), _MOST_LINES)
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        names = tuple(field.strip(' "') for field in line.split(","))
        if not any(names) or (not rows and names == COLUMNS):
            continue
        try:
            rows.append([float(field) for field in names])
        except ValueError:
            rows.append([])
        is_row = len(rows[-1]) == len(COLUMNS) and all(abs(x) <= _LARGEST for x in rows[-1])
        if not is_row:
            raise ValueError(f"line {number} is not the 8 numbers {','.join(COLUMNS)}; correct it")
        norm = math.hypot(*rows[-1][4:])
        if abs(norm - 1) > 0.01:
            raise ValueError(
                f"line {number}: the quaternion {rows[-1][4:]} has norm {norm:.3g}; give unit "
                "quaternions in the order qx,qy,qz,qw"
            )
        if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
            raise ValueError(f"line {number}: t {rows[-1][0]:g} s does not increase; sort by time")
    if len(rows) < 2:
        raise ValueError(f"{len(rows)} poses; a path needs at least 2")
    return np.array(rows)
