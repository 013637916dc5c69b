"""Exposures: light levels, sensors, products."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Annotated, Any

import pydantic

from megalopta.config.rendering import RenderingSettings
from megalopta.config.scene import ONCE, folder_name
from megalopta.core.bounded import folder_of
from megalopta.core.record import Record
from megalopta.scenes.imu import Imu
from megalopta.scenes.levels import illuminance_of
from megalopta.sensor import IMAGE_SENSORS, ImageSensor
from megalopta.sensor.formats.products import CubeSettings, ProductName
from megalopta.sensor.image_sensors import sensor_fields

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
        return value


LightLevels = Annotated[
    tuple[Annotated[LightLevel, pydantic.BeforeValidator(_level)], ...],
    pydantic.AfterValidator(_known_once),
]

_MOST_READINGS = 10**6
"""Most readings of an IMU in a sequence, 300 MB of text"""


class CalibrationFrames(Record, frozen=True):
    """Dark and flat frames that calibrate a sensor before its readings are corrected.

    They are drawn from the same device, with a seed of their own.
    """

    frames: Annotated[int, pydantic.Field(ge=2, le=100_000)] = 256
    """Number of dark frames, and of flat frames, which fill the pixel to half of its capacity"""
    hot_times: Annotated[float, pydantic.Field(gt=1)] = 10.0
    """Dark counts of a hot pixel, in multiples of the median, or of a frame camera in standard
    deviations from it; its neighbors replace it"""


class SensingSettings(RenderingSettings, frozen=True):
    """Exposures of a rendered scene, or of pictures."""

    light_levels: Annotated[LightLevels, pydantic.Field(min_length=1)] = (
        "twilight",
        "full_moon",
        "quarter_moon",
        "starlight",
    )
    """Levels to sense at, in lux or by name (daylight 1e5 lux, twilight 1, full_moon 0.25,
    quarter_moon 0.01, starlight 0.001, airglow 0.00082, moonless_forest_floor 0.00031,
    overcast_night 0.0001): the rendered light is scaled and keeps its color."""
    sensors: Annotated[
        tuple[ImageSensor, ...],
        pydantic.Field(
            min_length=1,
            description=f"Sensors to expose, from {', '.join(IMAGE_SENSORS)}. In YAML: a preset's "
            "name, a mapping with `preset` and changes to it, one of `kind` spad, ctia, frame or "
            "contrast with all fields, or the path of a device's YAML file; `efficiency: {path: "
            "FILE.csv}` is a curve, `measured: {dark_counts: FILE.npy}` a map. Paths are relative "
            "to the file that contains them and stay in its folder; on the command line, any.",
        ),
    ] = (IMAGE_SENSORS["spadcam"], IMAGE_SENSORS["ideal"])
    products: Annotated[tuple[ProductName, ...], ONCE] = ("counts",)
    """Output of `sense` for every sensor and level: `counts` (required), `events_hdf5`,
    `events_dsec`, `binary_npy`, `burst_npy`, `sums_npy`, `brackets_npy`, `changes_hdf5`, `tiff`
    (docs/reference/dataset-files.md)."""
    imu: Imu | None = pydantic.Field(default=None, exclude_if=lambda imu: imu is None)
    """Gyroscope and accelerometer on the rig, whose readings `sense` writes; default: none."""
    sub_frames: Annotated[int, pydantic.Field(ge=1, le=1000)] = 1
    """Equal parts of an exposure, with constant light in each. From 2 on, readings contain motion
    within a frame: light moves along the true flow to the next rendered frame, and after the last
    one continues as before. With 1, light is constant during a frame."""
    burst_hz: Annotated[float, pydantic.Field(gt=0, le=1e9)] = 100_000.0
    """Binary frames per second of the product `burst_npy`, and of `sums_npy`, `brackets_npy` and
    `changes_hdf5`, computed of the same; a whole multiple of the frame rate. They fill the time
    between rendered frames, which has `sub_frames` steps of light."""
    cubes: CubeSettings = pydantic.Field(
        default=CubeSettings(), exclude_if=lambda cubes: cubes == CubeSettings()
    )
    """Sums, brackets and changes that are computed of bursts."""
    free_running: bool = False
    """Expose SPAD arrays continuously: dead times and trapped carriers reach into the next frame,
    or binary frame of a burst; counts, events and bits of a frame show the same avalanches.
    Exposures must fill the frames. By default pixels are reset in every frame, as `dead_time.start`
    says."""
    correct: bool = False
    """Also correct readings of SPAD arrays for dark counts, dead time and counter, flat field and
    hot pixels, those of frame cameras for offsets, flat field and hot pixels. Detectors then run on
    both."""
    calibration: CalibrationFrames = CalibrationFrames()
    """Calibration frames of the correction."""
    expectation: bool = True
    """Store mean and variance of every reading, which `flow` and `report` need; they take most of
    the time and nine tenths of the disk."""

    @pydantic.field_validator("sensors", mode="before")
    @classmethod
    def _sensors_by_preset(cls, sensors: Any, validation: pydantic.ValidationInfo) -> Any:
        if isinstance(sensors, str) or not isinstance(sensors, Sequence):
            return sensors
        folder = folder_of(validation)
        return tuple(
            sensor_fields(sensor, folder) if isinstance(sensor, str | Mapping) else sensor
            for sensor in sensors
        )

    @pydantic.field_validator("products")
    @classmethod
    def _counts_are_made(cls, products: tuple[ProductName, ...]) -> tuple[ProductName, ...]:
        if "counts" not in products:
            raise ValueError("counts are missing, and motion detectors need them; add counts")
        return products

    @pydantic.model_validator(mode="after")
    def _exposures_suit_the_sequence(self) -> "SensingSettings":
        names = [folder_name(sensor.name) for sensor in self.sensors]
        if len(set(names)) < len(names):
            raise ValueError(f"sensors {names}: give each sensor a name of its own")
        samples = self.imu.samples(self.trajectory) if self.imu else 0
        if self.imu and samples > _MOST_READINGS:
            raise ValueError(
                f"imu.rate_hz {self.imu.rate_hz:g}: {samples} readings during the sequence; use a "
                f"lower rate, with at most {_MOST_READINGS} of them"
            )
        rendered = ("objects", "shutter", "stereo_with", "imu", "labels", "tracks")
        for name in () if self.scene.has_truth else rendered:
            if getattr(self, name) != type(self).model_fields[name].default:
                raise ValueError(f"{name}: pictures are not rendered; omit it")
        return self

    @property
    def exposures(self) -> list[tuple[ImageSensor, LightLevel]]:
        """Pairs of every sensor and every light level."""
        return list(product(self.sensors, self.light_levels))

    def check_exposures(self) -> None:
        """Refuse sensors that expose for longer than a frame. Raises ValueError."""
        rate_hz = self.trajectory.frame_rate_hz
        for sensor in self.sensors:
            readout_s = getattr(sensor, "readout_s", 0.0)
            if readout_s and self.shutter.readout_s:
                raise ValueError(
                    f"sensor {sensor.name!r}: readout_s {readout_s:g} and shutter.readout_s "
                    f"{self.shutter.readout_s:g} would delay rows twice; leave one of them at 0"
                )
            seen_s = sensor.exposure_s + (readout_s if self.sub_frames > 1 else 0.0)
            if seen_s * rate_hz > 1 + 1e-9:
                fields = "exposure_s + readout_s" if seen_s > sensor.exposure_s else "exposure_s"
                raise ValueError(
                    f"sensor {sensor.name!r}: {fields} {seen_s:g} is longer than a "
                    f"frame at trajectory.frame_rate_hz {rate_hz:g}; use at most {1 / rate_hz:g}"
                )
