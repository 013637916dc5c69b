"""Every camera behind one lens, on one flight, in one light: which of them sees the motion.

The image is the same on every die, in µm. Pixels see its mean over their square; between rendered
pixels it is smooth, without finer detail. Every second rendered frame is the middle of an exposure,
around which light moves along the true flow. Cameras expose for 1, ½, ¼ … of the time between
exposures, whichever gives most information on motion; arrays of one bit sum the binary frames that
fit into it, with gates of 1, ½, ¼ … of a frame, and k of n are −n·ln(1 − k/n) detections.

Event cameras always see. ON minus OFF events around each middle are a picture, from a settled
start; methods take these signed numbers as gray levels, and their information is not known.

Errors are at all rendered pixels visible in both frames. Methods see pixels of about the rendered
pitch or coarser, or sums of up to 8 × 8. The bound is for blocks of known texture, or the mean
motion if that is less.
"""

import math
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat
from scipy.integrate import trapezoid
from scipy.interpolate import PchipInterpolator

from megalopta.benchmark.methods import identity, velocity_methods
from megalopta.config.model import LightLevel, LightLevels, level_text, load
from megalopta.config.scene import ONCE
from megalopta.config.yaml_model import validated
from megalopta.core import bounded, files
from megalopta.core.arrays import Floats, bilinear
from megalopta.core.errors import refused_as
from megalopta.core.folders import locked
from megalopta.core.freshness import code_digest, digest
from megalopta.core.progress import progress
from megalopta.core.record import Record
from megalopta.dataset.sequence import Sequence as Rendered
from megalopta.dataset.store import Dataset, open_sequence
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid, block_sums
from megalopta.flow.metrics import translation_bound as bound
from megalopta.sensor import ImageSensor, Sensor, changed, expectation, expose, expose_events
from megalopta.sensor.calibrate.correction import filled_in
from megalopta.sensor.contrast.model import ContrastSensor
from megalopta.sensor.image_sensors import sensor_named
from megalopta.sensor.information import information, reading_noise
from megalopta.sensor.optics import blurred, detected_rate
from megalopta.sensor.quantities import histogram
from megalopta.sensor.sampling.streams import generator
from megalopta.sensor.shot import NextFrames
from megalopta.stages.run import require, run_stages

FLIGHTS = "flight-forward", "flight-sideways", "flight-yaw"
AS_SOLD, IDEAL = "as sold", "ideal"
TRANSMISSION = 0.9
OF_EVENTS = "DIS", "DeepFlow"
"""Methods for pictures of signed numbers"""
_BLUR_PX, _BLOCK_M, _FEWEST_PX = 0.6, 160e-6, 32
_PARTS, _HALVINGS = 4, 0.5 ** np.arange(13)
"""Parts of the time between rendered frames, at whose ends light is known; exposures tried"""
_DARKEST = 1e-3
"""Share of the mean light that darker pixels count as: their gradients are those of neighbors"""


class CamerasSettings(Record, frozen=True):
    """Cameras, light and lens of a comparison."""

    sensors: Annotated[tuple[str, ...], ONCE, Field(min_length=1)] = (
        *("imx900-high-gain", "imx174", "imx294", "zyla-5.5", "orca-quest-2", "ixon-888"),
        *("spad512s", "spad512-squared", "canon-3mp", "davis346"),
    )
    """Cameras: names of presets, or YAML files. An ideal detector is added."""
    light_levels: Annotated[LightLevels, Field(min_length=1)] = (0.001, 0.01, 0.1, 1, 10, 1000)
    """Light levels, in lux in the color of the rendering, or by name."""
    pitch_um: PositiveFloat = 10.0
    """Pitch of the comparison at equal pitch (µm)."""
    f_number: PositiveFloat = 1.4
    """Focal length over aperture of the lens, which transmits 0.9."""
    image_mm: PositiveFloat = 1.6
    """Width of the image on the die (mm)."""
    methods: Annotated[tuple[str, ...], ONCE, Field(min_length=1)] = ("PF", "DIS √", "DeepFlow √")
    """Flow methods; of each camera in each light the best counts. Event cameras: DIS, DeepFlow."""
    seed: int = 0
    """Seed of the photons."""


class Comparison(NamedTuple):
    """Cameras, and what was measured."""

    settings: CamerasSettings
    sensors: list[ImageSensor]
    """Cameras behind the lens, as sold, the ideal one first"""
    rows: pd.DataFrame
    """A row per camera, light, pair of frames and method; information is the trace of that on the
    displacement, mm⁻² per mm²; NaN where not known"""


def compare_cameras(
    scenes: Sequence[str | Path] = (), out: str | Path = "out/cameras", **settings: Any
) -> Comparison:
    """Return the errors and bounds of cameras on flights; finished parts are kept in `out`.

    `scenes`: datasets of one rendered sequence, or configurations, which are rendered; by default
    `FLIGHTS`. `settings`: fields of `CamerasSettings`. Raises UserError if one cannot be used.
    """
    chosen, out = validated(CamerasSettings, settings, "cameras"), Path(out)
    lens: dict[str, Any] = {"f_number": chosen.f_number, "transmission": TRANSMISSION}
    lens |= {"blur_m": 0.0, "transmission_curve": None, "falloff_fov_deg": None}
    with locked(out), refused_as("cameras"):
        named = [sensor_named(name) for name in dict.fromkeys((IDEAL, *chosen.sensors))]
        if len({sensor.name for sensor in named}) < len(named):
            raise ValueError("sensors: two have one name; give each its own")
        for sensor in named:
            if sensor.filters.is_on or sensor.kind not in ("spad", "frame", "contrast"):
                kinds = "a frame or event camera, or a SPAD array, without color filters"
                raise ValueError(f"sensor {sensor.name!r} cannot be compared; give {kinds}")
        flights = [Flight(_rendered(scene, out), chosen.image_mm) for scene in scenes or FLIGHTS]
        finest_m = min(item.pitch_m for item in (*flights, *named))
        sold = [changed(sensor, lens=lens) for sensor in named]
        sold[0] = changed(sold[0], pitch_m=finest_m)
        equal = [changed(sensor, pitch_m=1e-6 * chosen.pitch_um) for sensor in sold]
        methods = tuple(velocity_methods(chosen.methods).values())
        code = code_digest("megalopta.flow", "megalopta.sensor", __name__)
        code = digest(code, str(chosen.seed), *map(identity, methods))

        def measured(case: tuple[Flight, tuple[str, ImageSensor], LightLevel]) -> list[Any]:
            flight, (pixels, sensor), level = case
            key = digest(code, flight.hash, level_text(level), sensor.model_dump_json())
            path = out / "measured" / f"{key}.json"
            if not path.exists():
                files.write_json(path, list(_measured(flight, sensor, level, methods, chosen.seed)))
            advance()
            of = {"scene": flight.name, "pixels": pixels, "sensor": sensor.name, "level": level}
            return [of | row for row in bounded.read_json(path)]

        of_pixels = [(AS_SOLD, sensor) for sensor in sold]
        of_pixels += [(f"of {chosen.pitch_um:g} µm", sensor) for sensor in equal]
        cases = list(product(flights, of_pixels, chosen.light_levels))
        with (
            progress("Comparing cameras", len(cases), "case") as advance,
            ThreadPoolExecutor(os.cpu_count()) as threads,
        ):
            rows = [row for rows in threads.map(measured, cases) for row in rows]
    return Comparison(chosen, sold, pd.DataFrame(rows))


def _rendered(scene: str | Path, out: Path) -> Dataset:
    if Path(scene).is_dir():
        dataset = open_sequence(Path(scene))
        require(dataset, "render")
    else:
        configuration = load(str(scene))
        dataset = run_stages(out / "flights" / configuration.name, configuration, ("render",))
    dataset.require_truth()
    return dataset


class Flight:
    """Light and motion of a rendered sequence, of which every second frame is exposed."""

    def __init__(self, dataset: Dataset, image_mm: float) -> None:
        sequence, settings = Rendered(dataset), dataset.configuration
        if len(sequence) < 5:
            raise ValueError(f"{sequence.name} has {len(sequence)} frames; render 5 or more")
        last = (len(sequence) - 1) // 2 * 2
        self.name, self.shape, self.configuration = sequence.name, sequence.shape, settings
        self.pitch_m = 1e-3 * image_mm / sequence.shape[1]
        self.period_s = 2 / settings.trajectory.frame_rate_hz
        radiance = sequence.radiance[: last + 1]
        following = NextFrames(
            radiance=radiance[1:],
            flow=np.stack([sequence.flow(frame) for frame in range(last)]),
            hidden=np.stack([sequence.occlusion(frame) for frame in range(last)]),
        )
        way = np.arange(_PARTS) / _PARTS
        moving = [following.between(radiance, frame, way) for frame in range(last)]
        light = np.moveaxis(np.concatenate((*moving, radiance[last:])), -1, 0)
        self.light = np.stack([blurred(band, _BLUR_PX) for band in light], axis=-1)
        """(n, H, W, B) at the ends of all parts"""
        pairs = [(frame, frame + 2) for frame in range(1, last - 1, 2)]
        flow_px = np.stack([sequence.flow(*pair) for pair in pairs])
        hidden = np.stack([sequence.occlusion(*pair) for pair in pairs])
        self.flow_m = np.where(hidden[..., np.newaxis], np.nan, flow_px) * self.pitch_m
        """(T − 1, H, W, 2) on the die, NaN where hidden or unknown"""
        self.hash = digest(radiance.tobytes(), self.flow_m.tobytes(), str(self.period_s))
        self.light_on = lru_cache(4 * _PARTS)(self._light_on)

    def _light_on(self, pitch_m: float, parts: int) -> Floats:
        """Mean radiance (T, h, w, B) on pixels, from so many parts before the middles to after."""
        middles = range(_PARTS, len(self.light), 2 * _PARTS)
        ends = [self.light[middle - parts : middle + parts + 1] for middle in middles]
        means = [trapezoid(light, axis=0) / (2 * parts) if parts else light[0] for light in ends]
        return on_pixels(np.stack(means), pitch_m / self.pitch_m)


def on_pixels(light: NDArray[Any], pitch: float) -> Floats:
    """Return the mean of light (T, H, W, B) over each of the pixels that fit into the image.

    `pitch`: theirs over that of the given ones. Sums along rows and columns are monotone cubics.
    """
    for axis in (1, 2):
        samples = light.shape[axis]
        count = int(samples / pitch + 1e-9)
        edges = (np.arange(count + 1) - count / 2) * pitch + samples / 2
        sums = np.insert(light.cumsum(axis, dtype=np.float64), 0, 0.0, axis)
        light = np.diff(PchipInterpolator(np.arange(samples + 1), sums, axis)(edges), axis=axis)
        light /= pitch
    return light


class Setting(NamedTuple):
    """Exposure of a frame: parts of light before its middle, and after; frames of one bit."""

    sensor: ImageSensor
    parts: int = _PARTS
    frames: int = 1


def _is_binary(sensor: ImageSensor) -> bool:
    return getattr(sensor, "largest", 0) == 1


def _settings(sensor: ImageSensor, period_s: float) -> Iterator[Setting]:
    is_binary = _is_binary(sensor)
    gates, shares = (_HALVINGS, _HALVINGS[:4]) if is_binary else ((1.0,), _HALVINGS)
    for gate, share in product(gates, shares):
        exposure_s = gate * (sensor.exposure_s if is_binary else share * period_s)
        frames = max(round(share * period_s / sensor.exposure_s), 1) if is_binary else 1
        yield Setting(changed(sensor, exposure_s=exposure_s), round(_PARTS * share), frames)


def _measured(
    flight: Flight,
    sensor: ImageSensor,
    level: LightLevel,
    methods: Sequence[BlockDetector],
    seed: int,
) -> Iterator[dict[str, Any]]:
    """Yield the rows of a `Comparison` for a camera in a light."""
    scale, pitch_m = flight.configuration.light_scale(level), sensor.pitch_m
    bands = flight.configuration.render.bands_nm
    stream = f"cameras/{flight.name}/{level_text(level)}"

    def slopes(setting: Setting, frame: int) -> bound.ReadingSlopes:
        light = flight.light_on(pitch_m, setting.parts)[frame : frame + 1] * scale
        return motion_information(light, bands, setting)

    def trace(slopes: bound.ReadingSlopes) -> float:
        return float((slopes.information * slopes.gradient**2).sum(axis=0).mean())

    if is_contrast := isinstance(sensor, ContrastSensor):
        sensor = changed(sensor, exposure_s=flight.period_s)
        setting = Setting(sensor)
        light = on_pixels(flight.light, pitch_m / flight.pitch_m) * scale
        readings, noise, bits = net_events(light, bands, sensor, seed, stream)
        methods = tuple(velocity_methods(OF_EVENTS).values())
    else:
        setting = max(_settings(sensor, flight.period_s), key=lambda tried: trace(slopes(tried, 0)))
        light = flight.light_on(pitch_m, setting.parts) * scale
        readings, noise, bits = corrected_readings(light, bands, setting, seed, stream)
    bits_s_mm2 = bits * setting.frames / flight.period_s / (1e3 * pitch_m) ** 2
    shape = readings.shape[1:]
    finest = max(round(flight.pitch_m / pitch_m), 1)
    summed = {
        n: np.stack([block_sums(frame, BlockGrid(shape, n * finest)) for frame in readings])
        for n in (1, 2, 4, 8)
        if n == 1 or min(shape) >= n * finest * _FEWEST_PX
    }
    blocks = BlockGrid(shape, max(round(_BLOCK_M / pitch_m), 2))
    places_m = [(np.arange(n) + 0.5 - n / 2) * flight.pitch_m for n in flight.shape]
    for pair, true_m in enumerate(flight.flow_m):
        known = np.isfinite(true_m).all(axis=-1)
        motion_um = 1e6 * float(np.hypot(*true_m[known].T).mean())
        exposure = {"exposure_s": setting.sensor.exposure_s, "frames": setting.frames}
        facts: dict[str, Any] = {"pair": pair, **exposure, "bits_s_mm2": float(bits_s_mm2)}
        facts |= {"motion_um": motion_um, "information_mm4": None, "bound_um": None}
        if not is_contrast:
            fisher = slopes(setting, pair)
            least = np.trace(
                bound.cramer_rao_covariance(fisher.of_blocks(blocks)), axis1=-2, axis2=-1
            )
            least_um = 1e6 * pitch_m * np.sqrt(math.pi / 4 * least)
            facts["bound_um"] = float(np.minimum(least_um, motion_um).mean())
            facts["information_mm4"] = trace(fisher) / (1e3 * pitch_m) ** 4
        for method, (n, frames) in product(methods, summed.items()):
            side = n * finest
            aware = method.model_copy(update={"noise": (noise[0], noise[1] * side**2)})
            flow = np.nan_to_num(aware.dense(*frames[pair : pair + 2])) * side * pitch_m
            rows, columns = (
                (place_m / (side * pitch_m) + (count - 1) / 2).clip(0, count - 1)
                for place_m, count in zip(places_m, flow.shape, strict=False)
            )
            error = (bilinear(flow, *np.meshgrid(columns, rows)) - true_m)[known]
            errors_um = 1e6 * np.hypot(*error.T)
            name = method.name + (f", {n} × {n}" * (n > 1))
            means = float(errors_um.mean()), float(np.median(errors_um))
            yield facts | {"method": name, "mean_um": means[0], "median_um": means[1]}


def net_events(
    light: Floats, bands_nm: Any, sensor: ContrastSensor, seed: int, stream: str
) -> tuple[Floats, tuple[float, float], float]:
    """Return net events (T, h, w) of light (n, h, w, B) at the ends of parts, as readings."""
    rate_hz, parts = detected_rate(light, bands_nm, sensor), 2 * _PARTS
    starts = range(0, len(rate_hz) - 1, parts)
    ends = np.stack([rate_hz[start : start + parts + 1] for start in starts])
    events = expose_events(ends, sensor, seed=seed, stream=stream)
    net = histogram(events).astype(np.float64)
    return net, (1.0, 0.0), 64 * events.time_s.size / net.size


def motion_information(light: Floats, bands_nm: Any, setting: Setting) -> bound.ReadingSlopes:
    """Return what readings of light (1, h, w, B) tell of its motion, all summed frames together."""
    sensor = setting.sensor
    electrons = detected_rate(light, bands_nm, sensor)[0] * sensor.exposure_s
    lit = np.maximum(electrons, _DARKEST * electrons.mean())
    lights = np.geomspace(lit.min(), 1.001 * lit.max(), 24)
    share = information(lights, sensor) * lights  # of what an ideal detector tells
    per_electron = np.interp(np.log(lit), np.log(lights), share) / lit
    return bound.ReadingSlopes(bound.spline_gradient(electrons), setting.frames * per_electron)


def corrected_readings(
    light: Floats, bands_nm: Any, setting: Setting, seed: int, stream: str
) -> tuple[Floats, tuple[float, float], int]:
    """Return corrected readings (T, h, w) of light (T, h, w, B), their noise, and bits of each.

    Noise: a and b of the variance a·mean + b. A counter without limit has the bits of the largest
    reading.
    """
    sensor, frames = setting.sensor, setting.frames

    def detections(share: Floats) -> Floats:
        return -frames * np.log1p(-np.clip(share, 0, 1 - 0.5 / frames))

    flat = np.broadcast_to(np.median(light, axis=(0, 1, 2)), (1, *light.shape[1:]))
    stated = [expectation(even, bands_nm, sensor) for even in (0 * flat, flat)]
    dark, bright = (np.asarray(even.mean_reading[0], np.float64) for even in stated)
    if _is_binary(sensor):  # independent binary frames
        lit = expectation(light, bands_nm, sensor).mean_reading.clip(0, 1)
        sums = generator(seed, stream, sensor.model_dump_json()).binomial(frames, lit)
        readings, dark, bright = detections(sums / frames), detections(dark), detections(bright)
    else:
        exposure = expose(light, bands_nm, sensor, seed=seed, stream=stream)
        readings = exposure.counts.astype(np.float64)
    gain = (bright - dark) / max(float(np.median(bright - dark)), 1e-300)
    dark_noise, noise = (even.reading_variance[0] for even in stated)
    # hot: in the dark, above 4 times the variance of the median pixel in light
    bad = (gain < 0.2) | (dark_noise > 4.0 * max(np.median(noise), np.median(dark_noise)))
    corrected = (readings - dark) / np.where(bad, 1.0, gain)
    corrected, _ = filled_in(corrected, corrected, bad)
    slope, offset = reading_noise(sensor)
    counter, adc = getattr(sensor, "counter", None), getattr(sensor, "adc", None)
    bits = adc.bits if adc else getattr(counter, "adc_bits", None)
    if not bits:
        largest = readings.max()
        if isinstance(sensor, Sensor) and sensor.counter.is_on:
            largest = sensor.largest
        bits = max(math.ceil(math.log2(largest + 1)), 1)
    return corrected, (slope, max(offset + slope * float(dark[~bad].mean()), 0.0)), bits
