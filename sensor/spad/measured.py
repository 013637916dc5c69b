"""Measured device: a YAML file with the fields of `Sensor`, and maps of its pixels as .npy files.

`docs/how-to/spad.md` shows one. Paths are relative to the YAML file. The maps are hashed when the
file is read. A map that has changed since raises an error, so that a recorded fixed pattern stays
the same. Pickled objects are never loaded.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.core.bounded import file_content, named_path, plain_array
from megalopta.sensor.effects.base import AvalancheMaps, Effect

_LOWEST = {
    "breakdown": -np.finfo(float).max,
    "stuck": -1.0,
    "step": 1e-5,
    "leak": -np.finfo(float).max,
    "offset": -np.finfo(float).max,
}
"""Smallest value of each map, where it is not 0."""


class MapFile(BaseModel, frozen=True, extra="forbid", use_attribute_docstrings=True):
    """Map with one number per pixel, in a .npy file; a plain path is also accepted."""

    path: str
    """Path of the file."""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    """Expected SHA-256 hash of the file; another one raises an error; null: not checked."""
    fill_factor: Annotated[float | None, Field(exclude_if=lambda share: share is None)] = None
    """Of an efficiency: the fill factor with which it was measured; with another one, the map would
    be of other pixels, and is refused; null: not checked."""

    @model_validator(mode="before")
    @classmethod
    def _path_alone_will_do(cls, values: Any) -> Any:
        if isinstance(values, str | Path):
            return {"path": str(values)}
        if not isinstance(values, Mapping | cls):
            raise ValueError(f"{values!r} is not a file; give the path of a .npy file")
        return values


class MeasuredMaps(Effect, frozen=True):
    """Maps that replace drawn patterns; none by default."""

    of_effect: ClassVar[Mapping[str, str]] = {
        "efficiency": "efficiency",
        "dark_counts": "dark_counts",
        "bias": "breakdown",
    }
    """Effects that are on if they have a map"""
    relative: ClassVar[tuple[str, ...]] = (*AvalancheMaps._fields, "telegraph")
    """Maps of factors on the value of the effect of this name"""

    dark_counts: MapFile | None = None
    """Dark count rate of every pixel (Hz) at the reference bias and temperature."""
    efficiency: MapFile | None = None
    """Efficiency of every pixel relative to the curve, at the reference bias."""
    breakdown: MapFile | None = None
    """Breakdown voltage of every pixel relative to the nominal one (V)."""
    dead_time: MapFile | None = None
    """Dead time of every pixel relative to dead_time.dead_time_s."""
    afterpulsing: MapFile | None = None
    """Trapped carriers of every pixel relative to afterpulsing.mean_carriers."""
    crosstalk: MapFile | None = None
    """Neighbors that every pixel fires relative to crosstalk.mean_fired_neighbors."""
    telegraph: Annotated[MapFile | None, Field(exclude_if=lambda file: file is None)] = None
    """Step of every pixel's traps relative to telegraph.step; 0: it does not switch. Decides which
    pixels have traps, in place of telegraph.share."""
    stuck: Annotated[MapFile | None, Field(exclude_if=lambda file: file is None)] = None
    """Reading of every stuck or dead pixel in all frames; -1: the pixel works. Digital counters."""
    step: MapFile | None = None
    """Step of every pixel's analog counter (V)."""
    leak: MapFile | None = None
    """Leak of every pixel's analog counter (V/s)."""
    offset: MapFile | None = None
    """Output of every pixel's analog counter after reset, relative to the supply (V)."""
    fit: Literal["exact", "top_left", "center"] = "exact"
    """Part of a map larger than the image: top_left or center selects a window of the image's size,
    exact rejects the map."""

    @property
    def is_on(self) -> bool:
        """True if there is a map."""
        return any(getattr(self, name) for name in type(self).model_fields if name != "fit")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns that every map has. Raises ValueError as `load`, or without maps."""
        files = [getattr(self, name) for name in type(self).model_fields if name != "fit"]
        contents = [(file_content(file.path, "measured"), file.path) for file in files if file]
        sizes = [_map_of(*content, "measured").shape for content in contents]
        return min(rows for rows, _ in sizes), min(columns for _, columns in sizes)

    def load(self, shape: tuple[int, int]) -> dict[str, Floats]:
        """Read the maps that there are, for an image of (rows, columns) pixels.

        Raises ValueError if a file is missing, has changed, does not fit, or holds impossible
        values or no plain numbers.
        """
        maps: dict[str, Floats] = {}
        for name in type(self).model_fields:
            file, lowest, field = getattr(self, name), _LOWEST.get(name, 0.0), f"measured.{name}"
            if name == "fit" or file is None:
                continue
            content = file_content(file.path, field)
            if file.sha256 is not None and hashlib.sha256(content).hexdigest() != file.sha256:
                raise ValueError(
                    f"{field}: {file.path} has changed since it was first read; restore it, or "
                    "remove its sha256"
                )
            values = _map_of(content, file.path, field)
            if not np.all((values >= lowest) & (values < np.inf)):
                below = "" if lowest < -1e300 else f"below {lowest:g} or "
                raise ValueError(
                    f"{field}: {file.path} holds values {below}not finite; replace those pixels"
                )
            sizes = "{} × {}, the image {} × {} (rows × columns)".format(*values.shape, *shape)
            spare = np.subtract(values.shape, shape)
            if spare.min() < 0:
                raise ValueError(
                    f"{field}: {file.path} has {sizes}; lower camera.height or camera.width, or "
                    "measure more pixels"
                )
            if spare.max() > 0 and self.fit == "exact":
                raise ValueError(
                    f"{field}: {file.path} has {sizes}; set measured.fit to top_left or center to "
                    "use a part of it"
                )
            top, left = spare // 2 if self.fit == "center" else (0, 0)
            window = values[top : top + shape[0], left : left + shape[1]]
            maps[name] = window.astype(np.float64)
        return maps


def _map_of(content: bytes, path: str, field: str) -> NDArray[Any]:
    values = plain_array(content)
    if values is None or values.ndim != 2:
        raise ValueError(
            f"{field}: {path} does not hold one complete array (rows, columns) of plain numbers; "
            "write it with numpy.save"
        )
    return values


def with_hashes(maps: Any, folder: Path | None) -> Any:
    """Make the paths of a `measured` mapping absolute and add the hashes of files without one."""
    if not isinstance(maps, Mapping):
        return maps
    return {
        name: value if name == "fit" else _with_hash(value, folder, f"measured.{name}")
        for name, value in maps.items()
    }


def _with_hash(file: Any, folder: Path | None, field: str) -> Any:
    if isinstance(file, str):
        file = {"path": file}
    if not isinstance(file, Mapping) or not isinstance(file.get("path"), str):
        return file
    if file.get("sha256"):  # no other content will do, wherever it lies
        return {**file, "path": str(Path(folder or "", file["path"]).absolute())}
    path = str(named_path(file["path"], folder).absolute())
    content = file_content(path, field)
    _map_of(content, path, field)  # a damaged map is refused before any work
    return {**file, "path": path, "sha256": hashlib.sha256(content).hexdigest()}
