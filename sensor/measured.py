"""A measured device: a YAML file with the fields of `Sensor`, and maps of its pixels as .npy files.

    preset: spadcam
    name: spadcam-3
    measured:
      dark_counts: {path: dark_counts_hz.npy}
      breakdown: {path: breakdown_offset_v.npy}

Paths are relative to the YAML file. The maps are hashed when the file is read, and a map that has
changed since is refused, so that a fixed pattern on record stays what it was. Pickled objects are
never loaded.
"""

import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

Floats = NDArray[np.float64]


class MapFile(BaseModel, frozen=True, extra="forbid", use_attribute_docstrings=True):
    """One number per pixel, in a .npy file."""

    path: str
    """Where the file is."""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    """Hash of the file; a file with another one is refused. None: not checked."""


class MeasuredMaps(BaseModel, frozen=True, extra="forbid", use_attribute_docstrings=True):
    """Maps that take the place of drawn patterns; none by default."""

    dark_counts: MapFile | None = None
    """Dark count rate of every pixel (Hz) at the reference bias and temperature."""
    efficiency: MapFile | None = None
    """Efficiency of every pixel relative to the curve, at the reference bias."""
    breakdown: MapFile | None = None
    """Breakdown voltage of every pixel above the nominal one (V)."""


def load_map(file: MapFile, shape: tuple[int, int], field: str, lowest: float = 0.0) -> Floats:
    """Read a map of a device of (rows, columns) pixels.

    Raises
    ------
    ValueError
        When the file is missing, has changed, has another shape, holds no plain numbers or
        impossible ones.
    """
    try:
        content = Path(file.path).read_bytes()
        values = np.load(io.BytesIO(content), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise ValueError(
            f"{field}: {file.path} cannot be read as a .npy file of plain numbers: {error}"
        ) from error
    if file.sha256 is not None and hashlib.sha256(content).hexdigest() != file.sha256:
        raise ValueError(f"{field}: {file.path} has changed; restore it or read the device again")
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu":
        raise ValueError(f"{field}: {file.path} does not hold one array of plain numbers")
    if values.shape != shape:
        raise ValueError(
            f"{field}: {file.path} has shape {values.shape}, the image {shape}; use a map of the "
            "same size"
        )
    if not np.all((values >= lowest) & (values < np.inf)):
        raise ValueError(f"{field}: {file.path} holds values below {lowest:g} or not finite")
    return values.astype(np.float64)


def with_hashes(maps: Any, folder: Path) -> Any:
    """Make the paths of a `measured` mapping absolute and add the hashes of files without one."""
    if not isinstance(maps, Mapping):
        return maps
    return {name: _with_hash(file, folder) for name, file in maps.items()}


def _with_hash(file: Any, folder: Path) -> Any:
    if not isinstance(file, Mapping) or "path" not in file:
        return file
    path = (folder / str(file["path"])).resolve()
    if file.get("sha256"):
        return {**file, "path": str(path)}
    if not path.is_file():
        raise ValueError(f"measured: {path} does not exist; give the path of a .npy file")
    return {**file, "path": str(path), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
