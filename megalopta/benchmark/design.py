"""Design by bound: the exposure at which a sensor can measure flow or yaw rate to a stated error.

Light of a scene at an illuminance passes the lens and moves during the exposure, and the sensor
reads it. The information of the readings gives the least error of any unbiased method
(`flow.metrics.translation_bound`). With another pitch, the lens grows with the pixels, so that the
camera has the same view and f-number, and a pixel gathers light as its area.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, reduce
from itertools import combinations, product
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from megalopta.assets_gen import generator
from megalopta.assets_gen.surface_textures import dead_leaves
from megalopta.config.model import LightLevel, LightLevels
from megalopta.config.scene import ONCE
from megalopta.config.yaml_model import validated
from megalopta.core.arrays import Floats, first_reached
from megalopta.core.errors import refused_as
from megalopta.core.progress import progress
from megalopta.core.record import Record
from megalopta.dataset.frames import read_radiance_frame
from megalopta.dataset.store import Dataset, open_sequence
from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.metrics import translation_bound
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.levels import LEVELS, illuminance_of
from megalopta.sensor import Sensor, changed, without
from megalopta.sensor.frame.model import FrameSensor
from megalopta.sensor.image_sensors import sensor_named
from megalopta.sensor.optics import detected_rate

Positive = Annotated[float, Field(gt=0)]
Positives = Annotated[tuple[Positive, ...], ONCE]
Detecting = Sensor | FrameSensor

MEASURES = "error_px", "error_deg_s"
_REFLECTANCE = 0.2
_BANDS_NM = [(float(low), float(low + 25)) for low in range(400, 1000, 25)]
_RADII_PX = (1.5, 20.0)
_TURN_RAD, _LARGEST_TURN_DEG = 1e-4, 45
_MORE_BITS = 7
"""Bits of well, swing and ADC that keep readings from saturating, with the same noise"""


class DesignSettings(Record, frozen=True):
    """Settings of a design."""

    error: Annotated[str, Field(pattern=r"^\d*\.?\d+(e[+-]?\d+)? ?(px|deg/s)$")] = "0.1px"
    """Standard error to reach: of flow, such as 0.1px (per frame), or of yaw rate, such as
    2deg/s."""
    light_levels: Annotated[LightLevels, Field(min_length=1)] = (
        *("daylight", "twilight", "full_moon", "quarter_moon", "starlight"),
    )
    """Light levels, by name or in lux; lux have the color of daylight, or that of the dataset."""
    exposure_s: Positives = ()
    """Exposures to try (s), up to the time of a frame; by default five per decade, four decades."""
    pitch_m: Positives = ()
    """Pixel pitches to compare (m); by default the sensor's."""
    f_number: Positives = ()
    """F-numbers to compare; by default the lens's."""
    pde: Annotated[tuple[Annotated[float, Field(gt=0, le=1)], ...], ONCE] = ()
    """Peak photon detection efficiencies of a whole pixel to compare; by default the sensor's."""
    dark_counts_hz: Annotated[tuple[Annotated[float, Field(ge=0)], ...], ONCE] = ()
    """Dark counts of a pixel to compare (Hz), the same in all pixels; by default the sensor's."""
    yaw_deg_s: Annotated[float, Field(ge=0, le=1e4)] = 60.0
    """Turning rate of the camera (degrees per second), which causes motion blur."""
    frame_rate_hz: Positive = 50.0
    """Frames per second, which limit the exposure."""
    frames: Annotated[int, Field(ge=2, le=1000)] = 2
    """Frames from which one velocity is estimated."""
    block_px: Annotated[int, Field(ge=2)] = 24
    """Side of the blocks whose flow is estimated (px)."""
    camera: PerspectiveCamera = PerspectiveCamera(width=96, height=72, fov_deg=60)
    """Camera; a dataset has its own."""

    @model_validator(mode="after")
    def _can_be_reached(self) -> Self:
        if not 0 < self.target < math.inf:
            raise ValueError(f"error {self.error!r} is not positive; give one such as 0.1px")
        if self.yaw_deg_s > _LARGEST_TURN_DEG * self.frame_rate_hz:
            raise ValueError(
                f"yaw_deg_s {self.yaw_deg_s:g} at frame_rate_hz {self.frame_rate_hz:g} turns the "
                f"camera by more than {_LARGEST_TURN_DEG}° in a frame; lower the one or raise the "
                "other"
            )
        return self

    @property
    def target(self) -> float:
        """Stated error in its unit. Raises ValueError if it is not a number."""
        return float(self.error.rstrip("pxdeg/s "))

    @property
    def measure(self) -> str:
        """Field of `DesignPoint` that the stated error limits."""
        return MEASURES[0 if self.error.endswith("px") else 1]

    @property
    def exposures(self) -> tuple[float, ...]:
        """Exposures to try (s), shortest first. Raises ValueError if one is longer than a frame."""
        longest = 1 / self.frame_rate_hz
        if not self.exposure_s:
            return tuple((longest * 10.0 ** -np.linspace(4, 0, 21)).tolist())
        if max(self.exposure_s) > longest * (1 + 1e-9):
            raise ValueError(
                f"exposure_s {max(self.exposure_s):g} is longer than a frame, {longest:g} s; lower "
                "it or frame_rate_hz"
            )
        return tuple(sorted(self.exposure_s))

    @property
    def varied(self) -> dict[str, tuple[float, ...]]:
        """Values of the quantities that are compared, by name."""
        names = "pitch_m", "f_number", "pde", "dark_counts_hz"
        return {name: getattr(self, name) for name in names if getattr(self, name)}


class DesignScene(NamedTuple):
    """Light of a view, and its motion."""

    radiance: Callable[[LightLevel], Floats]
    """Radiance (1, H, W, B) at a light level, W·m⁻²·sr⁻¹·nm⁻¹"""
    bands_nm: list[tuple[float, float]]
    camera: Camera

    def flow_per_degree(self) -> Floats:
        """Return the flow (H, W, 2) when the camera turns by a degree to the right, px."""
        x, y, z = np.moveaxis(self.camera.directions(), -1, 0)
        turned = np.stack((x - _TURN_RAD * z, y, z + _TURN_RAD * x), axis=-1)
        return np.nan_to_num(self.camera.displacement(turned)) / math.degrees(_TURN_RAD)


class DesignPoint(NamedTuple):
    """Least errors of one sensor at one light level and exposure."""

    case: Mapping[str, float]
    """Values of the varied quantities"""
    level: LightLevel
    exposure_s: float
    error_px: float
    """Standard error of a component of a block's flow, px per frame, median over the blocks"""
    error_deg_s: float
    """Standard error of the yaw rate, degrees per second"""


class DesignRow(NamedTuple):
    """Least exposure that reaches the stated error, or why there is none."""

    case: Mapping[str, float]
    level: LightLevel
    exposure_s: float | None
    """None if no exposure reaches it"""
    best_exposure_s: float
    """Exposure of the least error"""
    best_error: float
    """Least error over the exposures, in the unit of the stated one"""
    limit: str
    """What keeps the error above the stated one; empty if it is reached"""


@dataclass(frozen=True)
class Design:
    """Errors over exposures, and the least exposure of every case."""

    sensor: Detecting
    settings: DesignSettings
    scene: str
    """Light that was used"""
    points: tuple[DesignPoint, ...]
    rows: tuple[DesignRow, ...]


def design(
    sensor: Detecting | str | Path, dataset: str | Path | None = None, **settings: Any
) -> Design:
    """Return the exposures at which a sensor can measure motion to a stated error.

    `sensor`: a SPAD array or frame camera, its name, or a YAML file; `dataset`: of one rendered
    sequence, whose first frame is the scene, by default dead leaves; `settings`: fields of
    `DesignSettings`, such as error and light_levels. Raises UserError if one cannot be used.
    """
    chosen = validated(DesignSettings, settings, "design")
    with refused_as("design"):
        named = sensor_named(sensor)
        if not isinstance(named, Detecting):
            raise ValueError(f"sensor {named.name!r} is of kind {named.kind}; give spad or frame")
        if named.filters.is_on:  # whose mosaic would count as texture that moves
            raise ValueError(f"sensor {named.name!r} has color filters; give one without a mosaic")
        if dataset is None:
            scene = leaves_scene(chosen, named)
        else:
            scene = _of_dataset(open_sequence(Path(dataset)))
        work = _Work(scene, chosen)
        names, values = tuple(chosen.varied), tuple(chosen.varied.values())
        cases = [dict(zip(names, case, strict=True)) for case in product(*values)]
        varied = [(case, varied_sensor(named, case)) for case in cases]  # refused before the work
        points: list[DesignPoint] = []
        rows = []
        with progress("Designing", len(cases) * len(chosen.light_levels), "case") as advance:
            for level, (case, device) in product(chosen.light_levels, varied):
                of_case = [
                    DesignPoint(case, level, time_s, *work.errors(device, level, time_s))
                    for time_s in work.times
                ]
                points += of_case
                errors = np.array([getattr(point, chosen.measure) for point in of_case])
                exposure_s = first_reached(work.times, errors, chosen.target)
                best, limit = int(errors.argmin()), "" if exposure_s else work.limit(device, level)
                least = work.times[best], float(errors[best])
                rows.append(DesignRow(case, level, exposure_s, *least, limit))
                advance(1)
    described = f"first frame of {dataset}" if dataset else "dead leaves"
    return Design(named, chosen, described, tuple(points), tuple(rows))


def varied_sensor(sensor: Detecting, case: Mapping[str, float]) -> Detecting:
    """Return the sensor with other values of pitch_m, f_number, pde and dark_counts_hz."""
    changes: dict[str, Any] = {name: case[name] for name in ("pitch_m",) if name in case}
    if "f_number" in case:
        changes["lens"] = {"f_number": case["f_number"]}
    if "pde" in case:
        if case["pde"] > sensor.fill_factor:
            raise ValueError(
                f"pde {case['pde']:g} is above the fill factor {sensor.fill_factor:g} of "
                f"{sensor.name}; lower it"
            )
        share = case["pde"] / sensor.fill_factor / max(sensor.efficiency.values)
        changes["efficiency"] = {"values": [min(1, share * p) for p in sensor.efficiency.values]}
    if isinstance(sensor, FrameSensor):  # dark current of an area, unless it is given
        area = (case.get("pitch_m", sensor.pitch_m) / sensor.pitch_m) ** 2
        changes["dark"] = {"mean_e_s": sensor.dark.mean_e_s * area}
        if "dark_counts_hz" in case:
            warm = {"log_sigma": 0.0, "reference_celsius": sensor.dark.celsius}
            changes["dark"] = {"mean_e_s": case["dark_counts_hz"], **warm}
    elif "dark_counts_hz" in case:
        sensor = without(sensor, "dark_counts")
        area_um2 = case.get("pitch_m", sensor.pitch_m) ** 2 * sensor.fill_factor * 1e12
        changes["dark_counts"] = {"bulk_mean_hz_um2": case["dark_counts_hz"] / area_um2}
    return changed(sensor, **changes)


class _Work:
    """Errors of a scene and settings."""

    def __init__(self, scene: DesignScene, settings: DesignSettings) -> None:
        self._scene, self._settings, self.times = scene, settings, settings.exposures
        self._per_degree = scene.flow_per_degree()
        self._light = lru_cache(maxsize=1)(
            lambda sensor, level: detected_rate(scene.radiance(level), scene.bands_nm, sensor)[0]
        )

    def errors(
        self, sensor: Detecting, level: LightLevel, exposure_s: float, blurs: bool = True
    ) -> tuple[float, float]:
        """Return the standard errors of flow (px per frame) and yaw rate (degrees per second)."""
        light, settings = self._light(sensor, level), self._settings
        if blurs:
            path_px = self._per_degree * (settings.yaw_deg_s * exposure_s)
            light = translation_bound.blurred_by_motion(light, path_px)
        slopes = translation_bound.reading_slopes(light, changed(sensor, exposure_s=exposure_s))
        blocks = slopes.of_blocks(block_grid(self._scene.camera.shape, settings.block_px, 1))
        least = translation_bound.cramer_rao_covariance(blocks, settings.frames)
        flow = np.median(np.sqrt(np.trace(least, axis1=-2, axis2=-1) / 2))
        spread = settings.frames * (settings.frames**2 - 1) / 12
        turn = slopes.of_turn(self._per_degree) * spread
        yaw = settings.frame_rate_hz / math.sqrt(turn) if turn > 0 else math.inf
        return float(flow), yaw

    def limit(self, sensor: Detecting, level: LightLevel) -> str:
        """Return the fewest causes without which the error would be reached."""
        measure, target = MEASURES.index(self._settings.measure), self._settings.target
        dark = "dark current" if isinstance(sensor, FrameSensor) else "dark counts"
        causes = "saturation", _BLUR, dark, "read noise"

        def least(*removed: str) -> float:
            better = reduce(_without_cause, removed, sensor)
            blurs = _BLUR not in removed
            return min(self.errors(better, level, t, blurs)[measure] for t in self.times[::-2])

        if (error := least(*causes)) > target:
            few = "too few photons in a frame"
            return few if math.isfinite(error) else "saturation, or a texture of one direction"
        for number in range(1, len(causes)):
            error, removed = min(
                (least(*subset), subset) for subset in combinations(causes, number)
            )
            if error <= target:
                return " and ".join(removed)
        return " and ".join(causes)


_BLUR = "motion blur"


def _without_cause(sensor: Detecting, cause: str) -> Detecting:
    """Return the sensor without what keeps an error from being reached."""
    wider = 2**_MORE_BITS
    if isinstance(sensor, FrameSensor):
        silent = dict.fromkeys(("median_e", "row_e", "column_e", "telegraph_e"), 0.0)
        changes: dict[str, dict[str, Any]] = {
            "dark current": {"dark": {"mean_e_s": 0.0}, "cic_e": 0.0},
            "read noise": {"read": silent},
            "saturation": {
                "full_well_e": min(1e7, sensor.full_well_e * wider),
                "em": {"well_e": sensor.em.well_e * wider},
                "adc": {"bits": min(24, sensor.adc.bits + _MORE_BITS)},
            },
        }
        return changed(sensor, **changes.get(cause, {}))
    counter = sensor.counter
    if cause == "dark counts":
        return without(sensor, "dark_counts")
    if cause == "read noise" and counter.kind != "digital":
        return changed(sensor, counter={"read_noise_v": 0.0, "adc_bits": None})
    if cause != "saturation":
        return sensor
    if counter.kind != "analog":
        return without(without(sensor, "counter"), "dead_time")
    bits = counter.adc_bits and min(24, counter.adc_bits + _MORE_BITS)
    volts = {name: wider * getattr(counter, name) for name in ("swing_v", "supply_v")}
    return without(changed(sensor, counter={**volts, "adc_bits": bits}), "dead_time")


def leaves_scene(settings: DesignSettings, sensor: Detecting) -> DesignScene:
    """Return dead leaves, as large as the view, in the bands that the sensor's curves cover."""
    curves = sensor.efficiency, sensor.lens.transmission_curve
    ends = [(curve.wavelengths_nm[0], curve.wavelengths_nm[-1]) for curve in curves if curve]
    bands = [
        band for band in _BANDS_NM if all(low <= band[0] and band[1] <= top for low, top in ends)
    ]
    if not bands:
        raise ValueError(f"{sensor.name}: its curves cover no light from 400 to 1000 nm")
    rows, columns = settings.camera.shape
    largest = min(_RADII_PX[1], min(rows, columns) / 2)
    image = dead_leaves((rows, columns), generator(0, "design"), (_RADII_PX[0], largest))
    reflectance = _REFLECTANCE * image / image.mean()

    def radiance(level: LightLevel) -> Floats:
        name = level if isinstance(level, str) else "daylight"
        scale = illuminance_of(level) / LEVELS[name].illuminance_lux / math.pi
        low, high = np.array(bands).T
        inside = np.linspace(low, high, 101)
        spectrum = scale * LEVELS[name].spectrum()(inside).mean(axis=0)
        return np.asarray(reflectance[np.newaxis, ..., np.newaxis] * spectrum)

    return DesignScene(radiance, bands, settings.camera)


def _of_dataset(dataset: Dataset) -> DesignScene:
    settings, frame = dataset.configuration, read_radiance_frame(dataset, 0).astype(np.float64)

    def radiance(level: LightLevel) -> Floats:
        return np.asarray(frame[np.newaxis] * settings.light_scale(level))

    return DesignScene(radiance, list(settings.render.bands_nm), settings.camera)
