"""Pictures of the user's own in place of a rendered scene: open, measure, configuration; copy."""

import math
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from megalopta.config.model import Configuration
from megalopta.config.yaml_model import validated
from megalopta.core import files
from megalopta.core.errors import UserError, refused_as
from megalopta.core.progress import progress, say, step
from megalopta.dataset import picture_light
from megalopta.dataset.store import Dataset
from megalopta.render import Footage, open_footage
from megalopta.scenes import Pictures
from megalopta.scenes.hashed_file import copied
from megalopta.scenes.levels import LEVELS, illuminance_of
from megalopta.scenes.spectra.spectrum import SPECTRA
from megalopta.scenes.stimuli.pictures import Unit

STILL_FRAMES = 16
"""Frames of a single picture, which does not move"""
_USUAL_HZ = 25.0
"""Pictures a second where a file tells no times"""
DEFAULTS: Mapping[str, Any] = {
    "light": {"level": "daylight"},
    "sensors": ["ideal"],
    "methods": ["BM", "LK", "DIS"],  # quick ones, which do with two frames
}
"""Settings of pictures that do not depend on the files"""
_SOURCE = "source"
_OF_SCENE = "unit", "between", "picture_rate_hz", "reflectance"


@dataclass(frozen=True, kw_only=True)
class PictureOptions:
    """Options of a user; None leaves them to the file, or to `Pictures`."""

    unit: Unit | None = None
    frame_rate_hz: float | None = None
    picture_rate_hz: float | None = None
    frames: int | None = None
    width: int | None = None
    between: str | None = None
    reflectance: float | None = None
    spectrum: str | None = None
    """Spectrum of white: a name that `Pictures` knows, or a light level"""
    photons: Sequence[float] = ()
    """Mean photons on a pixel of the first sensor in an exposure"""
    lux: Sequence[float] = ()
    """Illuminance of the scene, in place of photons"""
    luminance: Sequence[float] = ()
    """Mean luminance of the pictures, cd/m², in place of photons"""


def pictures_configuration(
    footage: Footage, asked: PictureOptions, overrides: Mapping[str, str]
) -> tuple[Configuration, picture_light.PictureLight]:
    """Return the configuration of a dataset of pictures, and their light, which is measured once.

    Settings that are given override those of the file. Raises UserError.
    """
    path = footage.path
    brightness_options = [
        f"--{name}" for name in ("photons", "lux", "luminance") if getattr(asked, name)
    ]
    brightness_options += ["--light-levels"] if "light_levels" in overrides else []
    if len(brightness_options) != 1 and (brightness_options or not footage.is_absolute):
        problem = " and ".join(brightness_options) or "pictures do not say how bright it was"
        raise UserError(
            f"{path}: {problem}; give one of --photons 2 (mean on a pixel in a frame), --lux 0.25 "
            "(on the scene: 0.001 stars, 0.25 full moon, 10 street, 500 indoors, 1e5 sun), "
            "--luminance 0.01 (mean of the pictures, cd/m²), --light-levels starlight"
        )
    settings = validated(Configuration, _fields(footage, asked), str(path), overrides)
    longest_s, sensors = 1 / settings.trajectory.frame_rate_hz, list(settings.sensors)
    for index, sensor in enumerate(sensors):
        if sensor.exposure_s > longest_s:
            say(f"sense: {sensor.name} exposes for {1e3 * longest_s:.3g} ms, the time of a frame")
            sensors[index] = sensor.model_copy(update={"exposure_s": longest_s})
    settings = settings.model_copy(update={"sensors": tuple(sensors)})
    with refused_as("render"):
        frames = picture_light.PictureFrames(footage, settings)
    brightness = _measured(frames)
    scene, light = cast(Pictures, settings.scene), settings.light
    bands_nm = settings.render.bands_nm
    lux_per_luminance = math.pi / scene.reflectance
    if footage.is_absolute:
        lux = brightness.luminance * lux_per_luminance
        light = light.model_copy(update={"illuminance_lux": lux})
    mean = brightness.mean
    with refused_as(str(path)):
        of_unit = scene.radiance_of_unit(light, bands_nm, mean, footage.bands_nm)
        levels = list(asked.lux) or [light.resolved().illuminance_lux]
        if asked.photons:
            per_lux = [
                picture_light.photons_per_lux(of_unit, light, bands_nm, sensor, mean)
                for sensor in sensors
            ]
            for sensor, photons in zip(sensors[1:], per_lux[1:], strict=True):
                share = f"{photons / per_lux[0]:.3g} on one of {sensor.name}"
                say(f"sense: each photon on a pixel of {sensors[0].name} is {share}")
            levels = [photons / per_lux[0] for photons in asked.photons]
        elif asked.luminance:
            levels = [luminance * lux_per_luminance for luminance in asked.luminance]
        levels = list(dict.fromkeys(float(f"{lux:.4g}") for lux in levels))  # they name files
        for level in levels:
            illuminance_of(level)
    light_levels = {} if "light_levels" in overrides else {"light_levels": tuple(levels)}
    settings = settings.model_copy(update={"light": light, **light_levels})
    return settings, picture_light.PictureLight(frames, brightness, of_unit)


def _fields(footage: Footage, asked: PictureOptions) -> dict[str, Any]:
    """Return the fields of the configuration: what file and options state, else `DEFAULTS`."""
    path, (rows, columns), count = footage.path, footage.shape, footage.count
    width = asked.width or columns
    height = max(1, round(rows * width / columns))
    scene = {name: getattr(asked, name) for name in _OF_SCENE}
    light = {}
    if asked.spectrum in LEVELS:
        scene["spectrum"], light = "light", {"light": {"level": asked.spectrum}}
    elif asked.spectrum in SPECTRA:
        scene["spectrum"] = asked.spectrum
    elif asked.spectrum is not None:
        names = ", ".join((*SPECTRA, *LEVELS))
        raise UserError(f"--spectrum {asked.spectrum}: unknown; give one of {names}")
    usual_hz = asked.picture_rate_hz or asked.frame_rate_hz or _USUAL_HZ
    end_s = float(picture_light.picture_times(footage, usual_hz)[-1])
    rate_hz = asked.frame_rate_hz or (shortest((count - 1) / end_s) if end_s else _USUAL_HZ)
    last_s = footage.last_s or 1 / rate_hz
    frames = math.floor((end_s + last_s) * rate_hz + 0.1) if count > 1 else STILL_FRAMES
    return {
        **DEFAULTS,
        "name": re.sub(r"[^A-Za-z0-9]+", "-", path.stem).strip("-")[:60] or "pictures",
        "scene": {
            "kind": "pictures",
            "file": str(path),
            **{name: value for name, value in scene.items() if value is not None},
        },
        "camera": {"width": width, "height": height},
        "benchmark": {"sizes": [max(3, min(60, height))]},
        "trajectory": {"frames": asked.frames or max(frames, 2), "frame_rate_hz": rate_hz},
        **({"render": {"bands_nm": footage.bands_nm}} if footage.bands_nm else {}),
        **light,
    }


def shortest(value: float) -> float:
    """Return the number of the fewest digits that agrees to 1e-9, such as 25 for 24.99…96."""
    rounded = (float(f"{value:.{digits}g}") for digits in range(1, 18))
    return next(number for number in rounded if math.isclose(number, value))


def _measured(frames: picture_light.PictureFrames) -> picture_light.Brightness:
    """Average over pictures, each so often as it is shown, and say how they become light.

    Raises UserError for black.
    """
    footage, settings, weights = frames.footage, frames.settings, frames.weights()
    scene, camera, trajectory = cast(Pictures, settings.scene), settings.camera, settings.trajectory
    if missed := max(weights) + 1 - len(weights):
        say(f"pictures: {missed} lie between two frames and are not shown; raise --frame-rate")
    end_s = float(frames.times_s[-1])
    held_s = trajectory.duration_s - end_s
    if len(frames.times_s) > 1 and held_s * trajectory.frame_rate_hz >= 1:
        say(f"pictures: they end after {end_s:.3g} s; the last is held for {held_s:.3g} s")
    shares = footage.luminance_shares
    mean, saturated = np.zeros(len(shares)), 0.0
    with progress(f"Reading {footage.path.name}", len(weights), "picture") as advance:
        for index in sorted(weights):
            mean += weights[index] * footage.mean(index)
            saturated += weights[index] * footage.saturated(index)
            advance()
    total = sum(weights.values())
    mean, luminance = mean / total, float(mean @ shares) / total
    if not luminance > 0:
        raise UserError(f"{footage.path} is black; give pictures with visible light in them")
    white = (
        "their spectra are used as they are"
        if footage.coding.name == "spectral radiance"
        else f"{footage.coding.name} codes become light, white has the spectrum of "
        f"{scene.white_name(settings.light)}, and the mean reflectance is "
        f"{100 * scene.reflectance:g} %"
    )
    lines = [
        f"{settings.trajectory.frames} frames of {camera.width} × {camera.height} px at "
        f"{settings.trajectory.frame_rate_hz:.6g} Hz from {footage.count} pictures; {white}"
    ]
    if footage.count == 1:
        lines.append("it is one picture, which stands still")
    lines += footage.notes
    saturated /= total
    if saturated:
        share = f"{100 * saturated:.2g} % of the pixels"
        lines.append(f"{share} are saturated in the file, so too dark")
    for line in lines:
        say(f"pictures: {line}")
    return picture_light.Brightness(tuple(mean.tolist()), saturated, luminance)


def import_pictures(dataset: Dataset) -> None:
    """Copy the files of the pictures into a dataset, and note what they are."""
    settings, scene = dataset.configuration, cast(Pictures, dataset.configuration.scene)
    if not dataset.light:
        with refused_as("scene.file"), open_footage(Path(scene.file.path), scene.unit) as footage:
            frames = picture_light.PictureFrames(footage, settings)
            light = picture_light.PictureLight(frames, _measured(frames), np.zeros(0))
            import_pictures(replace(dataset, light=light))
        return
    footage, brightness = dataset.light.frames.footage, dataset.light.brightness
    folder = picture_light.picture_folder(dataset)
    if not folder.exists():
        with (
            refused_as("scene.file"),
            step("copying the pictures"),
            files.atomic_write(folder) as temporary,
        ):
            temporary.mkdir()
            if Path(scene.file.path).is_dir():  # in their order, below source/
                (temporary / _SOURCE).mkdir()
                for number, file in enumerate(footage.files, 1):
                    name = f"{number:06d}{file.suffix.lower()}"
                    shutil.copyfile(file, temporary / _SOURCE / name)
                scene.file.check()  # afterwards, so that it was this that was copied
            else:
                copy = temporary / f"{_SOURCE}{footage.path.suffix.lower()}"
                with footage.opened() as source, copy.open("wb") as target:
                    scene.file.compare(copied(source, target))
    record = {
        "files": len(footage.files),
        "pictures": footage.count,
        "transfer": footage.coding.name,
        "notes": list(footage.notes),
        **asdict(brightness),
    }
    files.write_json(dataset.scene_record, {"pictures": record})


def check_pictures(settings: Configuration) -> None:
    """Refuse, with ValueError, pictures of another shape than the frames."""
    scene = cast(Pictures, settings.scene)
    if (file := Path(scene.file.path)).exists():  # else a dataset that came from elsewhere
        with refused_as("scene.file"), open_footage(file, scene.unit) as footage:
            picture_light.PictureFrames(footage, settings)
