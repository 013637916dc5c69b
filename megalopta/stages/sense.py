"""The sense stage: from radiance to the readings of every sensor at every light level, on disk.

Light is additive: one rendering, scaled, serves all levels; its direction stays.
"""

from contextlib import ExitStack
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta import sensor as sensors
from megalopta.config.model import Configuration, LightLevel, level_text
from megalopta.config.scene import own_fields
from megalopta.config.sensing import SensingSettings
from megalopta.core.arrays import Floats
from megalopta.core.bounded import undamaged
from megalopta.core.errors import UserError, refused_as, shell_command
from megalopta.core.freshness import SENSOR_MODEL
from megalopta.core.progress import progress, say
from megalopta.core.quantities import percent, with_error
from megalopta.dataset import sintel
from megalopta.dataset.frames import read_radiance_frame, read_radiance_frames, read_truth_frame
from megalopta.dataset.inertial import write_imu
from megalopta.dataset.picture_light import NextPictures, light_of
from megalopta.dataset.store import Dataset, exposure_name
from megalopta.scenes import ToneCurve
from megalopta.scenes.levels import illuminance_of
from megalopta.scenes.spectra.color import encode_srgb
from megalopta.sensor.formats import products
from megalopta.sensor.formats.counts_store import Origin
from megalopta.sensor.sampling.streams import Draw
from megalopta.sensor.shot import Following, NextFrames, Shot, State
from megalopta.stages.correction import write_corrected
from megalopta.stages.declaration import Stage
from megalopta.stages.noise_warning import noise_warning, variances

LIGHT_SPEED_M_S = 299_792_458.0


def sense(dataset: Dataset) -> None:
    """Expose what is missing, and write readings of the IMU and images."""
    if dataset.light:  # open pictures, for which nothing was made before
        with refused_as("sense"):
            _check(dataset.configuration)
    expose(dataset)
    if (imu := dataset.configuration.imu) and not dataset.imu.exists():
        write_imu(dataset.imu, dataset.configuration, imu)
    if not dataset.configuration.scene.has_truth:
        return
    # counts of the first sensor at the first level as gray images, on one scale
    sensor, level = dataset.configuration.exposures[0]
    counts = open_exposure(dataset, sensor, level)["counts"]
    curve = ToneCurve.of(counts[index] for index in range(len(counts)))
    for index in range(len(counts)):
        gray = encode_srgb(curve(np.maximum(counts[index], 0)))
        image = np.repeat(gray[..., None], 3, axis=-1)
        sintel.write_png(dataset.frame("training/final", index), image)


def expose(dataset: Dataset) -> None:
    """Expose what is missing: every frame is read once, for all sensors at all levels."""
    settings = dataset.configuration
    _warn_of_noise(dataset)
    with ExitStack() as stores:
        exposers = [_Exposer(dataset, *pair, stores) for pair in settings.exposures]
        exposers = [exposer for exposer in exposers if exposer.products]
        counting = [exposer for exposer in exposers if "events" in exposer.products]
        for first, radiance in read_radiance_frames(dataset) if counting else ():
            for exposer in counting:  # before anything is drawn
                exposer.check_events(first, radiance)
        frames = len(exposers) * settings.trajectory.frames
        advance = stores.enter_context(progress("Exposing sensors", frames, "frame"))
        for first, radiance in read_radiance_frames(dataset) if exposers else ():
            following = _next_frames(dataset, first, radiance)
            later_s = None
            if any(exposer.needs_depth for exposer in exposers):
                # time of light to what pixels see and back (n, H, W)
                per_meter = settings.camera.depth(np.ones(settings.camera.shape))
                indices = range(first, first + len(radiance))
                depths = [read_truth_frame(dataset, index).depth for index in indices]
                later_s = 2 * np.array(depths, np.float64) / per_meter / LIGHT_SPEED_M_S
            for exposer in exposers:
                exposer.expose(first, radiance, following, later_s)
                advance(len(radiance))
    for sensor in settings.sensors if settings.correct else ():
        opened = [open_exposure(dataset, sensor, level) for level in settings.light_levels]
        write_corrected(dataset, sensor, opened)


class _Exposer:
    """Exposes frames on one sensor at one light level, and writes the products that are missing."""

    def __init__(
        self, dataset: Dataset, sensor: sensors.ImageSensor, level: LightLevel, stores: ExitStack
    ) -> None:
        settings = self._settings = dataset.configuration
        self._sensor, self._counts = sensor, dataset.counts(sensor, level)
        self._what = f"sense: {sensor.name} at {level_text(level)}"
        self._stream = f"{dataset.sequence}/{exposure_name(sensor, level)}"
        self._scale = settings.light_scale(level).astype(np.float32)
        self._states: dict[str, State] = {}
        self._period_s = 1 / settings.trajectory.frame_rate_hz
        unusual: dict[str, Any] = {"level": level}
        if settings.sub_frames > 1:
            unusual |= {"sub_frames": settings.sub_frames}
        if settings.free_running:
            unusual |= {"free_running": True}
        origin = Origin(
            sensor=sensor,
            seed=settings.seed,
            sequence=self._stream,
            illuminance_lux=illuminance_of(level),
            extra=unusual,
        )
        shape = settings.trajectory.frames, *settings.camera.shape
        self.products: dict[products.Kind, list[products.Write]] = {}
        """Writers of the missing products, by the kind of their readings, which are drawn once"""
        for name in settings.products:
            if not (path := products.product_path(self._counts, name)).exists():
                timing = self._period_s, burst_frames(settings), settings.cubes
                writer = products.product_writer(name, path, origin, shape, *timing)
                write = stores.enter_context(writer)
                self.products.setdefault(products.kind_of(name), []).append(write)
        self.needs_depth = "histograms" in self.products and starts_at_camera(sensor)
        """True if pulses leave from the camera"""

    def expose(
        self,
        first: int,
        radiance: NDArray[np.float32],
        following: Following | None,
        later_s: Floats | None,
    ) -> None:
        """Expose frames (n, H, W, B), the first of which has number `first`."""
        shot = self._shot(first, radiance, following)
        if self.needs_depth:
            shot = replace(shot, later_s=later_s)
        with refused_as(self._what):
            for kind, writers in self.products.items():
                state = self._states.get(kind)  # after the last frame
                for reading, after in shot.drawn(kind, state, self._settings.expectation):
                    if kind == "readings" and not first:
                        self._tell_of_darkness(reading.counts[0])
                    self._states[kind] = after
                    for write in writers:
                        write(reading)

    def _tell_of_darkness(self, counts: NDArray[Any]) -> None:
        sensor, empty = self._sensor, float(np.mean(counts == 0))
        if isinstance(sensor, sensors.Sensor) and sensor.largest > 1 and empty > 2 / 3:
            time = with_error(sensor.exposure_s, 0, "s")
            say(f"{self._what}: {percent(empty)} of pixels count nothing in {time}; add light, or "
                "time, as in --sensors \"[{preset: …, exposure_s: 0.01}]\"")  # fmt: skip

    def check_events(self, first: int, radiance: NDArray[np.float32]) -> None:
        """Refuse, with UserError, frames (n, H, W, B) with more events than fit into memory."""
        with refused_as(self._what):
            self._shot(first, radiance, None).check_events()

    def _shot(self, first: int, radiance: NDArray[np.float32], following: Following | None) -> Shot:
        return Shot(
            radiance=radiance if (self._scale == 1).all() else radiance * self._scale,
            bands_nm=self._settings.render.bands_nm,
            sensor=self._sensor,
            draw=Draw(self._settings.seed, self._stream, first, self._period_s),
            following=following and following.scaled(self._scale),
            sub_frames=self._settings.sub_frames,
            burst_frames=burst_frames(self._settings),
            is_running=self._settings.free_running,
        )


def starts_at_camera(sensor: sensors.ImageSensor) -> bool:
    """True for a sensor whose pulsed source is at the camera."""
    return isinstance(sensor, sensors.Sensor) and sensor.tcspc.is_on and sensor.tcspc.from_camera


def _next_frames(dataset: Dataset, first: int, radiance: NDArray[np.float32]) -> Following | None:
    """Return the frames that follow frames (n, H, W, B); None if light stands still."""
    settings, end = dataset.configuration, first + len(radiance)
    if settings.sub_frames == 1:
        return None
    if not settings.scene.has_truth:
        return NextPictures(light_of(dataset), first, np.ones(len(settings.render.bands_nm)))
    truths = [read_truth_frame(dataset, index) for index in range(first, end)]
    flow = np.stack([truth.flow_forward for truth in truths])
    hidden = np.stack([truth.occluded_forward for truth in truths])
    if end == settings.trajectory.frames:  # the light continues as before
        flow[-1], hidden[-1] = -truths[-1].flow_backward, True
        after = radiance[-1]
    else:
        after = read_radiance_frame(dataset, end)
    following = np.concatenate((radiance[1:], after[np.newaxis]))
    return NextFrames(radiance=following, flow=flow, hidden=hidden)


def _warn_of_noise(dataset: Dataset) -> None:
    settings, noise = dataset.configuration, dataset.read_scene_record().get("monte_carlo") or {}
    if "covariance" not in noise:
        return
    shares = {}
    for sensor, level in settings.exposures:
        name = f"{sensor.name} at {level_text(level)}"
        with refused_as(f"sense: {name}"):
            scale = settings.light_scale(level)
            rendering, shot, detail = variances(noise, settings, sensor, scale)
        shares[name] = rendering / max(shot + detail, 1e-300)
    if warning := noise_warning(noise, settings, shares):
        say(f"sense: {warning}")


def open_exposure(
    dataset: Dataset, sensor: sensors.ImageSensor, level: LightLevel
) -> sensors.OpenedCounts:
    """Open the readings of a sensor at a light level. Raises UserError if they cannot be read."""
    path = dataset.counts(sensor, level)
    with undamaged(path, f"run: {shell_command('sense', dataset.root, '--redo')}"):
        settings = dataset.configuration
        return sensors.open_counts(path, (settings.trajectory.frames, *settings.camera.shape))


def require_expectation(dataset: Dataset) -> None:
    """Refuse, with UserError, readings that were stored without their expectation."""
    if not dataset.configuration.expectation:
        raise UserError(
            f"{dataset.root}: its readings have no stored mean and variance; add "
            f"them with: {shell_command('sense', dataset.root, '--expectation', 'true', '--redo')}"
        )


def burst_frames(settings: Configuration) -> int:
    """Binary frames of a burst per rendered frame."""
    return max(round(settings.burst_hz / settings.trajectory.frame_rate_hz), 1)


def _check(settings: Configuration) -> None:
    """Refuse what does not fit frames, and measured devices with unusable maps, as ValueError."""
    parts, rate_hz = settings.sub_frames, settings.trajectory.frame_rate_hz
    usual_hz = Configuration.model_fields["burst_hz"].default
    has_burst = "burst" in map(products.kind_of, settings.products)
    in_burst = burst_frames(settings) if has_burst else 1
    if parts > 1 and not settings.shutter.is_instant:
        raise ValueError(
            f"sub_frames {parts}: shutter already renders the motion within an exposure; "
            "use 1, or shutter.exposure_s 0 and shutter.readout_s 0"
        )
    if not has_burst and settings.burst_hz != usual_hz:
        raise ValueError(
            f"burst_hz {settings.burst_hz:g}: products has no burst_npy; add it, or leave "
            f"burst_hz at {usual_hz:g}"
        )
    if has_burst and parts == 1 and settings.scene.has_truth:
        raise ValueError("burst_npy: needs moving light; use sub_frames of 2 or more")
    if has_burst and abs(in_burst * rate_hz / settings.burst_hz - 1) > 1e-9:
        raise ValueError(
            f"burst_hz {settings.burst_hz:g}: not a whole multiple of trajectory.frame_rate_hz "
            f"{rate_hz:g}; use {in_burst * rate_hz:.12g}"
        )
    for sensor in settings.sensors:
        is_contrast = isinstance(sensor, sensors.ContrastSensor)
        if not (settings.free_running or is_contrast):
            continue
        setting = f"{'contrast' if is_contrast else 'free_running'}: sensor {sensor.name!r}"
        if is_contrast and not settings.shutter.is_instant:
            raise ValueError(f"{setting} has no shutter; use sub_frames, and a shutter of 0 s")
        if not isinstance(sensor, sensors.Sensor | sensors.ContrastSensor):
            raise ValueError(
                f"{setting} integrates and is reset in every frame; remove the setting or the "
                "sensor"
            )
        if abs(sensor.exposure_s * rate_hz - 1) > 1e-9:
            raise ValueError(
                f"{setting} with exposure_s {sensor.exposure_s:g} does not fill frames at "
                f"trajectory.frame_rate_hz {rate_hz:g}; use exposure_s {1 / rate_hz:.12g}, or "
                f"remove the {'sensor' if is_contrast else 'setting'}"
            )
    settings.cubes.check(settings.products, in_burst)
    settings.check_exposures()
    shape = settings.camera.height, settings.camera.width
    for sensor in settings.sensors:
        try:
            sensors.check_sensor(sensor, settings.render.bands_nm, shape)
            if settings.correct and getattr(sensor, "largest", None) == 1:
                raise ValueError(
                    "correct: one event saturates its counter; use `correct: false`, in a plan "
                    "`every: {correct: false}`"
                )
            for product in settings.products:
                products.check_product(product, sensor, shape)
            if starts_at_camera(sensor) and not settings.scene.has_truth:
                raise ValueError("tcspc.from_camera: pictures have no depth; use a rendered scene")
        except ValueError as problem:
            raise ValueError(f"sensor {sensor.name!r}: {problem}") from None


STAGE: Stage = Stage(
    name="sense",
    command="sense",
    fields=own_fields(SensingSettings),
    needs=("render",),
    outputs=lambda dataset: [
        dataset.root / "counts" / dataset.sequence,
        dataset.root / "training/final" / dataset.sequence,
        dataset.root / "corrected" / dataset.sequence,
        dataset.imu,
    ],
    work=sense,
    made_with=lambda _: {
        "model": str(SENSOR_MODEL),
        "numpy": version("numpy"),
        "numba": version("numba"),
    },
    check=_check,
    rehearse=_check,
)
