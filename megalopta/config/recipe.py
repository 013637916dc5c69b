"""A plan: a dataset of any size in one file, with values drawn for each sequence."""

import math
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, ValidationInfo, field_validator, model_validator

from megalopta.config import built_in_names
from megalopta.config.scene import ONCE
from megalopta.config.yaml_model import mapping, validated, yaml_text
from megalopta.core.bounded import folder_of, named_path, quoted
from megalopta.core.errors import UserError, nearest, shell_command
from megalopta.core.format_numbers import check_format
from megalopta.core.record import Record
from megalopta.scenes.trajectories.base import Mount
from megalopta.sensor.formats.products import ProductName

Stream: TypeAlias = Callable[[str], float]
"""Number in [0, 1) for the value at a path, such as "scenes.0.scene.trees"."""

FlowFile = Literal["kitti_png", "flo5"]
_LONGEST_SPLIT, _SHARES_OFF = 60, 0.01
_KINDS = ("uniform", "log_uniform", "integer", "one_of")
Entry = str | float | dict[str, Any]
"""A name, a number, or fields, any of which may be a range."""


class RigCamera(Mount, frozen=True):
    """Camera of a rig: its place, and in what it differs from the plan's cameras."""

    camera: dict[str, Any] = Field(default={}, exclude_if=lambda fields: not fields)
    """Fields of `camera` that differ"""
    render: dict[str, Any] = Field(default={}, exclude_if=lambda fields: not fields)
    """Fields of `render` that differ, such as `bands_nm`"""
    shutter: dict[str, Any] = Field(default={}, exclude_if=lambda fields: not fields)
    """Fields of `shutter` that differ"""
    sensors: tuple[Entry, ...] = Field(default=(), exclude_if=lambda sensors: not sensors)
    """Sensors in place of the plan's"""

    @property
    def mount(self) -> Mount:
        """Its place alone."""
        return Mount(position_m=self.position_m, rotation_deg=self.rotation_deg)


_FILE_KEYS = ("csv", "file", "files", "panorama", "path")
_FILE_SUFFIXES = (".csv", ".npy", ".yaml", ".yml")
"""Keys and values that name files."""


class Plan(Record, frozen=True):
    """Sequences to draw; each depends on seed and index alone.

    Any value inside `scenes`, `lights`, `cameras`, `trajectories`, `every`, `sensors` and
    `light_levels` may be a range: `{uniform: [1, 5]}`, `{log_uniform: [1, 100]}`, `{integer: [0,
    9]}`, `{one_of: [a, b]}`.
    """

    name: str = "Low-light optical flow"
    """Title of the dataset"""
    description: str = (
        "Rendered sequences with exact optical flow, and the readings of photon-counting sensors"
    )
    """Description in a sentence or two"""
    sequences: Annotated[int, Field(ge=1, le=10_000_000)] = 10
    """Number of sequences; a larger number later keeps the finished ones"""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of all draws"""
    scenes: Annotated[tuple[Entry, ...], Field(min_length=1)] = ("demo",)
    """Scenes: a built-in configuration's name, or a mapping with `preset`, its name, and fields to
    change. They are dealt out in random order: each comes once before one comes again"""
    lights: tuple[Entry, ...] = ()
    """Lights, dealt out likewise: a level's name or fields of `light`; default: the preset's"""
    cameras: tuple[dict[str, Any], ...] = ()
    """Cameras, dealt out likewise: fields of `camera`; default: the preset's"""
    trajectories: tuple[dict[str, Any], ...] = ()
    """Camera paths, dealt out likewise: fields of `trajectory`; default: the preset's"""
    every: dict[str, Any] = Field(default={})
    """Fields of the configuration set in every sequence, after all others"""
    sensors: Annotated[tuple[Entry, ...], Field(min_length=1)] = ("spadcam",)
    """Sensors that expose every sequence, as in a configuration"""
    light_levels: Annotated[tuple[Entry, ...], Field(min_length=1)] = ("twilight",)
    """Light levels of every sensor, by name or in lux"""
    rig: tuple[RigCamera, ...] = Field(default=(), exclude_if=lambda rig: not rig)
    """Cameras that follow each path together: their places relative to the path's camera, and
    perhaps another `camera`, `render`, `shutter` or `sensors`. Each is a sequence of its own. Two
    alike side by side also get the disparity to each other"""
    repeats: Annotated[int, Field(ge=1, le=1000)] = 1
    """Exposures per sensor and level, with independent noise; from the second on, the sensor's name
    ends in -r2, -r3, …"""
    products: Annotated[tuple[ProductName, ...], ONCE] = ("counts",)
    """Output per exposure, as in a configuration"""
    flow_files: Annotated[tuple[FlowFile, ...], ONCE] = ()
    """Formats of flow next to .flo: kitti_png, 16-bit PNG in training/flow_kitti; flo5, HDF5 in
    training/flow_flo5"""
    splits: dict[str, Annotated[float, Field(ge=0)]] = Field(
        default={"train": 0.8, "validation": 0.1, "test": 0.1}
    )
    """Share of the sequences in each split, in sum 1, or whole numbers in proportion, such as 3 and
    1; of any number of first sequences each split has its share, to one"""
    sample: Annotated[int, Field(ge=0)] = 2
    """Number of first sequences that also form the split "sample", a small download"""

    @field_validator(
        "scenes", "lights", "cameras", "trajectories", "every", "sensors", "rig", mode="before"
    )
    @classmethod
    def _files_are_placed(cls, values: Any, validation: ValidationInfo) -> Any:
        return _placed(values, folder_of(validation))

    @field_validator("scenes", "lights", "cameras", "trajectories", "sensors", "light_levels")
    @classmethod
    def _ranges_are_ranges(cls, entries: tuple[Any, ...]) -> tuple[Any, ...]:
        for index, entry in enumerate(entries):
            check_ranges(entry, str(index))
        return entries

    @field_validator("every")
    @classmethod
    def _every_is_drawn(cls, fields: dict[str, Any]) -> dict[str, Any]:
        check_ranges(fields, "")
        planned = {"name", "seed", "sensors", "light_levels", "products"} & fields.keys()
        if planned:
            raise ValueError(f"{sorted(planned)[0]}: the plan sets it; remove it from every")
        return fields

    @field_validator("scenes")
    @classmethod
    def _presets_are_known(cls, entries: tuple[Any, ...]) -> tuple[Any, ...]:
        for index, entry in enumerate(entries):
            name = entry.get("preset") if isinstance(entry, Mapping) else entry
            if name not in built_in_names():
                remedy = nearest(str(name), built_in_names())
                raise ValueError(f"{index}: preset {name!r} is unknown; {remedy}")
        return entries

    @model_validator(mode="after")
    def _rigs_are_complete(self) -> "Plan":
        if self.sequences % self.cameras_per_path:
            raise ValueError(
                f"sequences {self.sequences}: a rig of {len(self.rig)} cameras makes as many "
                "sequences of each path; give a multiple"
            )
        return self

    @property
    def cameras_per_path(self) -> int:
        """Number of sequences that show the same scene and path."""
        return max(len(self.rig), 1)

    @field_validator("splits")
    @classmethod
    def _splits_are_shares(cls, splits: dict[str, float]) -> dict[str, float]:
        for name in splits:
            if not name.isidentifier() or len(name) > _LONGEST_SPLIT or name == "sample":
                raise ValueError(
                    f"{quoted(name, 60)!r} cannot name a split: use letters, digits and _, at most "
                    f"{_LONGEST_SPLIT}"
                )
        if not sum(splits.values()) > 0:
            raise ValueError("give at least one split a share above 0")
        total = sum(splits.values())
        if abs(total - 1) > _SHARES_OFF and any(share % 1 for share in splits.values()):
            raise ValueError(f"the sum of shares is {total:.4g}; make it 1, or use whole numbers")
        return splits


def load_plan(path: Path, overrides: Mapping[str, str] | None = None) -> Plan:
    """Read a plan from a YAML file or a dataset's folder, and apply settings.

    Files that a plan names lie in its folder; those of a dataset's plan, in the working folder.
    Raises UserError if the file is no plan, or a sequence of its entries cannot be made.
    """
    is_dataset = path.is_dir()
    path = path / "dataset.yaml" if is_dataset else path
    if path == Path("challenge") and not path.exists():
        path = Path(__file__).with_name("challenge.yaml")
    values = mapping(yaml_text(path, "plan; give a YAML file"), str(path))
    if "megalopta" in values:
        check_format("dataset", values, path)
        if "plan" not in values:
            raise UserError(f"{path}: dataset of one sequence, without a plan; give a YAML file")
        values = values["plan"]
    if "scene" in values:
        raise UserError(
            f"{path}: the configuration of one sequence; make it with: "
            f"{shell_command('render', path)}, or give a plan with `scenes`"
        )
    folder = Path() if is_dataset else path.parent
    return validated(Plan, values, str(path), overrides, folder)


def _placed(value: Any, folder: Path | None, key: object = None) -> Any:
    """Return values of a plan with the paths of the files that it names (`named_path`)."""
    if isinstance(value, Mapping):
        return {name: _placed(inner, folder, name) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_placed(inner, folder, key) for inner in value]
    is_text = isinstance(value, str) and "\n" not in value
    if is_text and (key in _FILE_KEYS or value.lower().endswith(_FILE_SUFFIXES)):
        place = named_path(value, folder)
        is_below = place.is_absolute() and place.is_relative_to(Path.cwd())
        return str(place.relative_to(Path.cwd()) if is_below else place)
    return value


def draw_entry(value: Any, at: Stream, path: str = "") -> Any:
    """Replace every range by a drawn value, also inside mappings and lists."""
    if kind := _kind(value):
        return _drawn(kind, value[kind], at, path)
    if isinstance(value, Mapping):
        return {key: draw_entry(inner, at, f"{path}.{key}") for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [draw_entry(inner, at, f"{path}.{index}") for index, inner in enumerate(value)]
    return value


def choose(values: list[Any], at: Stream, path: str) -> tuple[int, Any]:
    """Draw one of some values: its index and the value, ranges included."""
    index = min(int(at(path) * len(values)), len(values) - 1)
    return index, values[index]


def check_ranges(value: Any, path: str) -> None:
    """Check the ranges of a value. Raises ValueError."""
    if kind := _kind(value):
        limits = value[kind]
        place = f"{path}: {kind} {limits!r}"
        if not isinstance(limits, list | tuple) or not limits:
            raise ValueError(f"{place}: give a list")
        if kind != "one_of":
            types = int if kind == "integer" else (int, float)
            if len(limits) != 2 or not all(
                isinstance(limit, types) and not isinstance(limit, bool) and math.isfinite(limit)
                for limit in limits
            ):
                numbers = "whole numbers" if kind == "integer" else "numbers"
                raise ValueError(f"{place}: give two {numbers}, in ascending order")
            if limits[0] > limits[1]:
                raise ValueError(f"{place}: give the lower number first")
            if kind == "log_uniform" and limits[0] <= 0:
                raise ValueError(f"{place}: give numbers above 0")
        value = limits if kind == "one_of" else None
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key in _KINDS:
                raise ValueError(f"{path}: {key} excludes other keys; remove them")
            if isinstance(inner, list) and (near := get_close_matches(str(key), _KINDS, 1, 0.7)):
                kinds = ", ".join(_KINDS)
                raise ValueError(f"{path}: no draw {key!r}, only {kinds}; did you mean {near[0]}?")
            check_ranges(inner, f"{path}.{key}".strip("."))
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            check_ranges(inner, f"{path}.{index}")


def _kind(value: Any) -> str | None:
    if isinstance(value, Mapping) and len(value) == 1:
        (name,) = value
        return name if name in _KINDS else None
    return None


def _drawn(kind: str, limits: Any, at: Stream, path: str) -> Any:
    if kind == "one_of":
        index, chosen = choose(list(limits), at, path)
        return draw_entry(chosen, at, f"{path}.{index}")
    low, high = limits
    place = at(path)
    if kind == "integer":
        return min(low + int(place * (high - low + 1)), high)
    is_log = kind == "log_uniform"
    value = low * (high / low) ** place if is_log else low + place * (high - low)
    # short enough for a file's name
    return min(max(float(f"{value:.5g}"), float(low)), float(high))
