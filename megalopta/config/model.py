"""The frozen configuration of a sequence: YAML file, command line, provenance record.

A YAML file gives any part of it; the rest has defaults. On the command line a field is named by its
path, `--scene.trees 200`, and its value is read as YAML.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from megalopta.config import built_in_names, built_in_text
from megalopta.config.measuring import (
    ONCE,
    CalibrationFrames,
    FlowSettings,
    LabelName,
    SequenceBenchmark,
    TrackSettings,
)
from megalopta.config.yaml_model import mapping, validated, yaml_text
from megalopta.core.bounded import quoted
from megalopta.core.errors import UserError, refused_as, shell_command
from megalopta.core.named_file import folder_of, named_path
from megalopta.core.record import Record
from megalopta.core.validation import merged
from megalopta.flow.detectors.registry import METHODS, THESIS_METHODS
from megalopta.render import RenderSettings
from megalopta.scenes import AnyObject, AnyScene, Shutter
from megalopta.scenes.build import AnyCamera, CameraPath, build_scene
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.forest.description import Forest
from megalopta.scenes.imu import Imu
from megalopta.scenes.levels import illuminance_of, level_named
from megalopta.scenes.light import Light
from megalopta.scenes.spectra.spectrum import check_known
from megalopta.scenes.trajectories.base import Mount
from megalopta.scenes.trajectories.orbit import Fit, Orbit, bounds_of
from megalopta.scenes.trajectories.steady import Trajectory
from megalopta.sensor import IMAGE_SENSORS, ImageSensor
from megalopta.sensor.formats.products import ProductName
from megalopta.sensor.spad.presets import load_sensor, with_files

LightLevel = float | str


def level_text(level: LightLevel) -> str:
    """A light level as text, such as "starlight" or "0.05lux"."""
    return level if isinstance(level, str) else f"{level:.12g}lux"


def _known_once(levels: tuple[LightLevel, ...]) -> tuple[LightLevel, ...]:
    for level in levels:
        illuminance_of(level)
    if len(set(map(level_text, levels))) < len(levels):
        raise ValueError(f"{list(levels)}: duplicate level; give each once")
    return levels


def _level(value: Any) -> Any:
    """Return a level by the name or, if it is a quoted number, in lux."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return level_named(value)


LightLevels = Annotated[
    tuple[Annotated[LightLevel, BeforeValidator(_level)], ...], AfterValidator(_known_once)
]

# Longer values, such as a recorded path, are cut in comparisons of two configurations.
_LONGEST_VALUE = 60
# File names hold sensor, repeat, level, product, and a prefix during writing; file systems allow
# 255 bytes.
_LONGEST_NAME = 100
_MOST_READINGS = 10**6
"""Most readings of an IMU in a sequence, 300 MB of text"""
_MOST_POINTS = 10**8
"""Most places of followed points in a sequence, 0.9 GB"""


class Configuration(Record, frozen=True):
    """A sequence: its scene, rendering, sensors and measurements."""

    name: str = "forest"
    """Name of the sequence and its folders: letters, digits, dash and underscore."""

    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of rendering noise and photon arrivals."""

    scene: AnyScene = Forest()
    """Scene to render."""

    objects: tuple[AnyObject, ...] = ()
    """Boxes, balls and mesh files (`file`) added to the scene, at rest or on paths of their own."""

    light: Light = Light()
    """Light that the scene is rendered under."""

    camera: AnyCamera = PerspectiveCamera()
    """Projection, image size and field of view."""

    scene_camera: AnyCamera | None = Field(default=None, exclude_if=lambda camera: camera is None)
    """Camera that the scene's detail and extent suit, on a rig of different cameras; default: this
    one."""

    trajectory: CameraPath = Trajectory()
    """Camera motion."""

    stereo_with: Mount | None = Field(default=None, exclude_if=lambda mount: mount is None)
    """Second camera of the rig on the path, side by side with this one: `training/disparities`
    holds the disparity to it. By default there is none."""

    shutter: Shutter = Shutter()
    """Motion blur and rolling shutter of the sensors' frames."""

    render: RenderSettings = Field(RenderSettings(), validate_default=True)
    """Samples, depth, bands and backend."""

    labels: Annotated[tuple[LabelName, ...], ONCE] = Field(
        default=(), exclude_if=lambda labels: not labels
    )
    """Label maps that `render` writes for other programs: `classes`, `instances`, `clusters` of
    leaves, `normals`, `albedo`; default: none."""

    tracks: TrackSettings | None = Field(default=None, exclude_if=lambda tracks: tracks is None)
    """Points that `render` follows through all frames; default: none."""

    light_levels: Annotated[LightLevels, Field(min_length=1)] = (
        "twilight",
        "full_moon",
        "quarter_moon",
        "starlight",
    )
    """Levels to sense at, by name or in lux: the rendered light is scaled and keeps its color."""

    sensors: Annotated[
        tuple[ImageSensor, ...],
        Field(
            min_length=1,
            description=f"Sensors to expose, from {', '.join(IMAGE_SENSORS)}. In YAML: a preset's "
            "name, a mapping with `preset` and changes to it, one of `kind` spad or ctia with all "
            "fields, or the path of a measured device's YAML file; `efficiency: {path: FILE.csv}` "
            "is a curve, `measured: {dark_counts: FILE.npy}` a map. Paths are relative to the file "
            "that contains them and stay in its folder; on the command line, any.",
        ),
    ] = (
        IMAGE_SENSORS["spadcam"],
        IMAGE_SENSORS["ideal"],
    )

    products: Annotated[tuple[ProductName, ...], ONCE] = ("counts",)
    """Output of `sense` for every sensor and level: `counts` (required), `events_hdf5`,
    `events_npz`, `binary_npy`, `binary_spad512`, `burst_npy`, `tiff` (docs/file-formats.md)."""

    imu: Imu | None = Field(default=None, exclude_if=lambda imu: imu is None)
    """Gyroscope and accelerometer on the rig, whose readings `sense` writes; default: none."""

    sub_frames: Annotated[int, Field(ge=1, le=1000)] = 1
    """Equal parts of an exposure, with constant light in each. From 2 on, readings contain motion
    within a frame: light moves along the true flow to the next rendered frame, and after the last
    one continues as before. With 1, light is constant during a frame."""

    burst_hz: Annotated[float, Field(gt=0, le=1e9)] = 100_000.0
    """Binary frames per second of the product `burst_npy`, a whole multiple of the frame rate. They
    fill the time between rendered frames, which has `sub_frames` steps of light."""

    free_running: bool = False
    """Expose SPAD arrays continuously: dead times and trapped carriers reach into the next frame,
    or binary frame of a burst; counts, events and bits of a frame show the same avalanches.
    Exposures must fill the frames. By default pixels are reset in every frame, as `dead_time.start`
    says."""

    correct: bool = False
    """Also correct readings of SPAD arrays for dark counts, dead time and counter, flat field and
    hot pixels. Detectors then run on both."""

    calibration: CalibrationFrames = CalibrationFrames()
    """Calibration frames of the correction."""

    methods: Annotated[
        tuple[str, ...],
        ONCE,
        Field(min_length=1, description=f"Motion detectors to run, of {', '.join(METHODS)}."),
    ] = THESIS_METHODS

    flow: FlowSettings = FlowSettings()
    """References of the detectors' responses."""

    expectation: bool = True
    """Store mean and variance of every reading, which `flow` and `report` need; they take most of
    the time and nine tenths of the disk."""

    benchmark: SequenceBenchmark = SequenceBenchmark(sizes=(60,))
    """Search for the photons that each detector needs."""

    @field_validator("name")
    @classmethod
    def _name_is_a_folder(cls, name: str) -> str:
        return _folder_name(name)

    @field_validator("render")
    @classmethod
    def _depth_suits_the_scene(
        cls, render: RenderSettings, validation: ValidationInfo
    ) -> RenderSettings:
        scene = validation.data.get("scene")
        if scene is None or "max_depth" in render.model_fields_set:
            return render
        return render.model_copy(update={"max_depth": scene.max_depth})

    @field_validator("sensors", mode="before")
    @classmethod
    def _sensors_by_preset(cls, sensors: Any, validation: ValidationInfo) -> Any:
        if isinstance(sensors, str) or not isinstance(sensors, Sequence):
            return sensors
        folder = folder_of(validation)
        return tuple(_resolve_sensor(sensor, folder) for sensor in sensors)

    @field_validator("products")
    @classmethod
    def _counts_are_made(cls, products: tuple[ProductName, ...]) -> tuple[ProductName, ...]:
        if "counts" not in products:
            raise ValueError("counts are missing, and motion detectors need them; add counts")
        return products

    @field_validator("methods")
    @classmethod
    def _methods_are_known(cls, methods: tuple[str, ...]) -> tuple[str, ...]:
        for method in methods:
            if method not in METHODS:
                raise ValueError(f"{method!r} is unknown: use some of {', '.join(METHODS)}")
        return methods

    @model_validator(mode="after")
    def _parts_fit(self) -> "Configuration":
        if self.scene.has_truth:  # pictures may hold spectra of their own
            white, name = self.scene.white(self.light), f"light {self.light.level!r}"
            check_known(name, white.range_nm, self.render.bands_nm, "")
        names = [_folder_name(sensor.name) for sensor in self.sensors]
        if len(set(names)) < len(names):
            raise ValueError(f"sensors {names}: give each sensor a name of its own")
        self._check_shutter(1 / self.trajectory.frame_rate_hz)
        self._check_stereo()
        self._check_imu()
        self._check_tracks()
        if not self.scene.has_truth:
            self._check_pictures()
        if self.light.asks_for_a_sky and not self.scene.is_lit_from_outside:
            raise ValueError(
                f"light.{'panorama' if self.light.panorama else 'sky'}: a scene of kind "
                f"{self.scene.kind!r} has its own light; omit it, or use a forest"
            )
        if self.scene.is_hazy and self.render.integrator == "baked":
            raise ValueError(
                "render.integrator 'baked': baked light has no haze; use 'auto' or 'path', or "
                "omit scene.haze"
            )
        return self

    @property
    def exposures(self) -> list[tuple[ImageSensor, LightLevel]]:
        """Pairs of every sensor and every light level."""
        return list(product(self.sensors, self.light_levels))

    def _check_pictures(self) -> None:
        """Refuse settings that only rendered scenes have."""
        for name in ("objects", "shutter", "stereo_with", "imu", "labels", "tracks"):
            if getattr(self, name) != type(self).model_fields[name].default:
                raise ValueError(f"{name}: pictures are not rendered; omit it")

    def _check_stereo(self) -> None:
        if self.stereo_with and self.camera.intrinsics is None:
            raise ValueError(
                f"stereo_with: the {self.camera} has no lines along which to shift points; use a "
                "pinhole, or omit it"
            )
        if self.stereo_with and self.baseline_m is None:
            raise ValueError(
                "stereo_with: the two cameras do not look the same way side by side; change "
                "position_m along x only, or omit it"
            )

    def _check_imu(self) -> None:
        samples = self.imu.samples(self.trajectory) if self.imu else 0
        if self.imu and samples > _MOST_READINGS:
            raise ValueError(
                f"imu.rate_hz {self.imu.rate_hz:g}: {samples} readings during the sequence; use a "
                f"lower rate, with at most {_MOST_READINGS} of them"
            )

    def _check_tracks(self) -> None:
        frames, last = self.trajectory.frames, max(self.tracks.frames) if self.tracks else 0
        if last >= frames:
            raise ValueError(f"tracks.frames {last}: the sequence has frames 0 to {frames - 1}")
        if self.tracks:
            points = len(self.tracks.frames) * len(self.tracks.points(self.camera)) * frames
            if points > _MOST_POINTS:
                raise ValueError(
                    f"tracks.spacing_px {self.tracks.spacing_px}: {points:.2g} places of points in "
                    f"all frames; use a larger spacing, with at most {_MOST_POINTS:.0e}"
                )

    @property
    def baseline_m(self) -> float | None:
        """Distance to the camera `stereo_with`, m, positive to the right; None without one."""
        own = self.trajectory.mount or Mount()
        return own.baseline_m(self.stereo_with) if self.stereo_with else None

    def check_exposures(self) -> None:
        """Refuse sensors that expose for longer than a frame. Raises ValueError."""
        rate_hz = self.trajectory.frame_rate_hz
        for sensor in self.sensors:
            if sensor.exposure_s * rate_hz > 1 + 1e-9:
                raise ValueError(
                    f"sensor {sensor.name!r}: exposure_s {sensor.exposure_s:g} is longer than a "
                    f"frame at trajectory.frame_rate_hz {rate_hz:g}; use at most {1 / rate_hz:g}"
                )

    def _check_shutter(self, period_s: float) -> None:
        shutter = self.shutter
        for name in ("exposure_s", "readout_s"):
            if getattr(shutter, name) > period_s * (1 + 1e-9):
                raise ValueError(
                    f"shutter.{name} {getattr(shutter, name):g} is longer than a frame at "
                    f"trajectory.frame_rate_hz {self.trajectory.frame_rate_hz:g}; use at most "
                    f"{period_s:g}"
                )


def _folder_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
        raise ValueError(f"{name!r} cannot name a folder: use letters, digits, - and _")
    if len(name) > _LONGEST_NAME:
        raise ValueError(f"{quoted(name, 40)!r}: use a name of at most {_LONGEST_NAME} characters")
    return name


def _resolve_sensor(sensor: Any, folder: Path | None) -> Any:
    if isinstance(sensor, str) and sensor.endswith((".yaml", ".yml")):
        return load_sensor(named_path(sensor, folder))
    if isinstance(sensor, str):
        sensor = {"preset": sensor}
    if not isinstance(sensor, Mapping):
        return sensor
    sensor = with_files(sensor, folder)
    if "preset" not in sensor:
        return {"kind": "spad", **sensor}
    name = sensor["preset"]
    if not isinstance(name, str) or name not in IMAGE_SENSORS:
        raise ValueError(f"preset {name!r} is unknown: use one of {', '.join(IMAGE_SENSORS)}")
    changes = {key: value for key, value in sensor.items() if key != "preset"}
    return merged(IMAGE_SENSORS[name].model_dump(mode="json"), changes)


def load(source: str, overrides: Mapping[str, str] | None = None) -> Configuration:
    """Read a configuration and apply overrides. Raises UserError.

    The source is the name of a built-in configuration, a YAML file or a dataset's folder. Overrides
    map the path of a field, such as "scene.trees", to a value in YAML.
    """
    if source in built_in_names():
        return parse(built_in_text(source), source, overrides)
    path = Path(source)
    path = path / "dataset.yaml" if path.is_dir() else path
    known = f"configuration; give a YAML file or one of {', '.join(built_in_names())}"
    return parse(yaml_text(path, known), source, overrides, path.parent)


def parse(
    text: str,
    source: str,
    overrides: Mapping[str, str] | None = None,
    folder: Path | None = None,
) -> Configuration:
    """Configuration from YAML text; `source` names it in errors. Raises UserError.

    `folder` is that of the file with the text, in which what it names must lie (`named_path`).
    """
    values = mapping(text, source)
    if "configuration" in values:  # a dataset.yaml
        values = values["configuration"]
    if "plan" in values:
        raise UserError(f"{source}: a dataset of many sequences; give the configuration of one")
    if "scenes" in values:
        raise UserError(
            f"{source}: a plan of many sequences; make them with: "
            f"{shell_command('dataset', 'make', source)}"
        )
    settings = validated(Configuration, values, source, overrides, folder)
    is_another_scene = settings.scene.kind != values.get("scene", {}).get("kind", "forest")
    if is_another_scene and not {"render", "render.max_depth"} & (overrides or {}).keys():
        render = settings.render.model_copy(update={"max_depth": settings.scene.max_depth})
        settings = settings.model_copy(update={"render": render})
    return fitted(settings)


def fitted(settings: Configuration) -> Configuration:
    """Replace a path of kind `fit` by the circle around the scene that it stands for.

    Raises UserError if the scene cannot be built, or is made for its camera.
    """
    path = settings.trajectory
    if not isinstance(path, Fit):
        return settings
    if settings.scene.is_made_for_camera:
        raise UserError(
            f"trajectory.kind 'fit': a scene of kind {settings.scene.kind!r} is made for its "
            "camera; use another path"
        )
    with refused_as("scene"):
        anywhere = Orbit(frames=path.frames, frame_rate_hz=path.frame_rate_hz)
        camera, objects = settings.scene_camera or settings.camera, settings.objects
        scene = build_scene(settings.scene, settings.light, camera, anywhere, objects)
    orbit = path.around(bounds_of(scene), camera)
    return settings.model_copy(update={"trajectory": orbit})


def by_content(values: Any) -> Any:
    """Return dumped settings without the paths of files with a hash, which stands for them."""
    if isinstance(values, Mapping):
        left_out = {"path"} if values.get("sha256") else set[str]()
        return {key: by_content(values[key]) for key in values if key not in left_out}
    return [by_content(value) for value in values] if isinstance(values, list) else values


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Lines "path: old → new" for every value that differs between two dumped configurations.

    The same file at another path is the same value.
    """
    before, after = dict(_leaves(by_content(old))), dict(_leaves(by_content(new)))
    return [
        f"{path}: {_brief(before.get(path, 'absent'))} → {_brief(after.get(path, 'absent'))}"
        for path in {**before, **after}
        if before.get(path, ...) != after.get(path, ...)
    ]


def _brief(value: Any) -> str:
    text = str(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]!r}…"


def _leaves(values: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(values, Mapping):
        for key, value in values.items():
            yield from _leaves(value, f"{path}.{key}" if path else str(key))
    elif isinstance(values, list) and any(isinstance(value, Mapping) for value in values):
        for index, value in enumerate(values):
            yield from _leaves(value, f"{path}.{index}")
    else:
        yield path, values
