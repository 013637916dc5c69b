"""Pictures of the user's own in place of a rendered scene: open, measure, configuration; copy."""

import json
import math
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from megalopta.config.model import Configuration, by_content
from megalopta.config.yaml_model import validated
from megalopta.core import files
from megalopta.core.errors import UserError, refused_as
from megalopta.core.progress import progress, say, step
from megalopta.dataset.picture_light import (
    PictureFrames,
    photons_per_lux,
    picture_folder,
    picture_times,
)
from megalopta.dataset.store import Dataset
from megalopta.render import Footage, open_footage
from megalopta.scenes import Pictures
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
    "light_levels": [1.0],
    "methods": ["BM", "LK", "DIS"],  # quick ones, which do with two frames
}
"""Settings of pictures that do not depend on the files; `light_levels` is for the user to say"""
_LEAST_SIZE = 3
"""Smallest side in the photon benchmark, px"""
_SOURCE = "source"
_OF_SCENE = "unit", "between", "picture_rate_hz", "reflectance"
_DIGITS = 4
"""Digits of a light level, which names files"""


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


@dataclass(frozen=True)
class Measured:
    """Pictures that a sequence shows, and their light."""

    files: tuple[Path, ...]
    pictures: int
    shape: tuple[int, int]
    transfer: str
    notes: tuple[str, ...]
    mean: tuple[float, ...]
    """Mean of linear red, green and blue over all frames, or of each channel of spectra"""
    saturated: float
    """Share of pixels at the largest code of any color"""
    luminance: float
    """Mean luminance, in the unit of the linear values; of spectra cd/m²"""


def pictures_configuration(
    path: Path, asked: PictureOptions, overrides: Mapping[str, str]
) -> Configuration:
    """Return the configuration of a dataset of pictures; settings that are given override it.

    Raises UserError.
    """
    with open_footage(path, asked.unit) as footage:
        is_absolute, of_channels_nm = footage.is_absolute, footage.bands_nm
        given = [f"--{name}" for name in ("photons", "lux", "luminance") if getattr(asked, name)]
        given += ["--light-levels"] if "light_levels" in overrides else []
        if len(given) != 1 and (given or not is_absolute):
            what = " and ".join(given) or "pictures do not say how bright it was"
            raise UserError(
                f"{path}: {what}; give one of --photons 2 (mean on a pixel in a frame), --lux 0.25 "
                "(on the scene: 0.001 stars, 0.25 full moon, 10 street, 500 indoors, 1e5 sun), "
                "--luminance 0.01 (mean of the pictures, cd/m²), --light-levels starlight"
            )
        fields = _fields(path, footage, asked)
        settings = _short_exposures(validated(Configuration, fields, str(path), overrides))
        _say_times(settings, footage)
        found = _measured[_shown(settings)] = _measure(settings, footage)
    scene, light = _scene(settings), settings.light
    lux_per_luminance = math.pi / scene.reflectance
    if is_absolute:
        lux = found.luminance * lux_per_luminance
        light = light.model_copy(update={"illuminance_lux": lux})
        settings = settings.model_copy(update={"light": light})
    if "light_levels" in overrides:
        return settings
    with refused_as(str(path)):
        levels = list(asked.lux) or [light.resolved().illuminance_lux]
        bands_nm, first = settings.render.bands_nm, settings.sensors[0]
        of_unit = scene.radiance_of_unit(light, bands_nm, found.mean, of_channels_nm)
        if asked.photons:
            per_lux = [
                photons_per_lux(of_unit, light, bands_nm, sensor, found.mean)
                for sensor in settings.sensors
            ]
            for sensor, photons in zip(settings.sensors[1:], per_lux[1:], strict=True):
                share = f"{photons / per_lux[0]:.3g} on one of {sensor.name}"
                say(f"sense: each photon on a pixel of {first.name} is {share}")
            levels = [photons / per_lux[0] for photons in asked.photons]
        elif asked.luminance:
            levels = [luminance * lux_per_luminance for luminance in asked.luminance]
        levels = [float(f"{lux:.{_DIGITS}g}") for lux in levels]
        for level in levels:
            illuminance_of(level)
    return settings.model_copy(update={"light_levels": tuple(dict.fromkeys(levels))})


def _fields(path: Path, footage: Footage, asked: PictureOptions) -> dict[str, Any]:
    """Return the fields of the configuration that the file and the options state."""
    rows, columns = footage.shape
    width = asked.width or columns
    height = max(1, round(rows * width / columns))
    is_level = asked.spectrum in LEVELS
    if not is_level and asked.spectrum not in (None, *SPECTRA):
        names = ", ".join((*SPECTRA, *LEVELS))
        raise UserError(f"--spectrum {asked.spectrum}: unknown; give one of {names}")
    scene = {name: getattr(asked, name) for name in _OF_SCENE}
    scene["spectrum"] = "light" if is_level else asked.spectrum
    given = {name: value for name, value in scene.items() if value is not None}
    return {
        **DEFAULTS,
        "name": re.sub(r"[^A-Za-z0-9]+", "-", path.stem).strip("-")[:60] or "pictures",
        "scene": {"kind": "pictures", "file": str(path), **given},
        "light": {"level": asked.spectrum} if is_level else DEFAULTS["light"],
        "camera": {"width": width, "height": height},
        "trajectory": timing_of(footage, asked),
        "render": {"bands_nm": footage.bands_nm} if footage.bands_nm else {},
        "benchmark": {"sizes": [max(_LEAST_SIZE, min(60, height))]},
    }


def timing_of(footage: Footage, asked: PictureOptions) -> dict[str, Any]:
    """Frames and their rate: as in the file, unless something else is asked for."""
    count = len(footage)
    times_s = picture_times(footage, asked.picture_rate_hz or asked.frame_rate_hz or _USUAL_HZ)
    end_s = float(times_s[-1])
    rate_hz = asked.frame_rate_hz or (shortest((count - 1) / end_s) if end_s else _USUAL_HZ)
    last_s = footage.last_s or 1 / rate_hz
    frames = math.floor((end_s + last_s) * rate_hz + 0.1) if count > 1 else STILL_FRAMES
    return {"frames": asked.frames or max(frames, 2), "frame_rate_hz": rate_hz}


def shortest(value: float) -> float:
    """Return the number of the fewest digits that agrees to 1e-9, such as 25 for 24.99…96."""
    rounded = (float(f"{value:.{digits}g}") for digits in range(1, 18))
    return next(each for each in rounded if math.isclose(each, value))


def _short_exposures(settings: Configuration) -> Configuration:
    """Return the configuration with exposures of a frame at most, and say which are shorter now."""
    longest_s = 1 / settings.trajectory.frame_rate_hz
    sensors = []
    for sensor in settings.sensors:
        if sensor.exposure_s > longest_s:
            say(f"sense: {sensor.name} exposes for {1e3 * longest_s:.3g} ms, the time of a frame")
            sensor = sensor.model_copy(update={"exposure_s": longest_s})
        sensors.append(sensor)
    return settings.model_copy(update={"sensors": tuple(sensors)})


def _say_times(settings: Configuration, footage: Footage) -> None:
    """Say which pictures no frame shows, and for how long the last one is held."""
    rate_hz = settings.trajectory.frame_rate_hz
    scene = _scene(settings)
    end_s = float(picture_times(footage, scene.picture_rate_hz or rate_hz)[-1])
    shown = PictureFrames(footage, settings).weights()
    if missed := max(shown) + 1 - len(shown):
        say(f"pictures: {missed} lie between two frames and are not shown; raise --frame-rate")
    held_s = settings.trajectory.duration_s - end_s
    if len(footage) > 1 and held_s * rate_hz >= 1:
        say(f"pictures: they end after {end_s:.3g} s; the last is held for {held_s:.3g} s")


def _scene(settings: Configuration) -> Pictures:
    return cast(Pictures, settings.scene)


def _shown(settings: Configuration) -> str:
    """Return pictures, with the hash of their file, and the times at which they are shown."""
    shown = settings.model_dump(mode="json", include={"scene", "trajectory"})
    return json.dumps(by_content(shown))


_measured: dict[str, Measured] = {}
"""Pictures that this process has measured, by what is shown"""


def measured(settings: Configuration) -> Measured:
    """Measure the pictures that a sequence shows, once in a process. Raises UserError for black."""
    key, scene = _shown(settings), _scene(settings)
    if key not in _measured:
        with refused_as("scene.file"), open_footage(Path(scene.file.path), scene.unit) as footage:
            _measured[key] = _measure(settings, footage)
    return _measured[key]


def _measure(settings: Configuration, footage: Footage) -> Measured:
    """Average over pictures, each so many times as it is shown."""
    weights = PictureFrames(footage, settings).weights()
    mean, saturated = np.zeros(len(footage.luminance_shares)), 0.0
    with progress(f"Reading {footage.path.name}", len(weights), "picture") as advance:
        for index in sorted(weights):
            mean += weights[index] * footage.mean(index)
            saturated += weights[index] * footage.saturated(index)
            advance()
    total = sum(weights.values())
    mean, luminance = mean / total, float(mean @ footage.luminance_shares) / total
    if not luminance > 0:
        raise UserError(f"{footage.path} is black; give pictures with visible light in them")
    return Measured(
        tuple(footage.files),
        len(footage),
        footage.shape,
        footage.transfer,
        tuple(footage.notes),
        tuple(mean.tolist()),
        saturated / total,
        luminance,
    )


def import_pictures(dataset: Dataset) -> None:
    """Copy the files of the pictures into a dataset, and note what they are."""
    settings, scene = dataset.configuration, _scene(dataset.configuration)
    folder, found = picture_folder(dataset), measured(settings)
    if not folder.exists():
        with (
            refused_as("scene.file"),
            step("copying the pictures"),
            files.atomic_write(folder) as temporary,
        ):
            place = temporary
            if Path(scene.file.path).is_dir():  # in their order, below source/
                place = temporary / _SOURCE
            place.mkdir(parents=True)
            for index, file in enumerate(found.files, 1):
                name = _SOURCE if place == temporary else f"{index:06d}"
                shutil.copyfile(file, place / f"{name}{file.suffix.lower()}")
            scene.file.check()  # afterwards, so that it was this that was copied
    record = {**asdict(found), "files": len(found.files), "notes": list(found.notes)}
    del record["shape"]
    files.write_json(dataset.scene_record, {"pictures": record})
    camera, white = settings.camera, scene.white_name(settings.light)
    light = (
        "their spectra are used as they are"
        if found.transfer == "spectral radiance"
        else f"{found.transfer} codes become light, white has the spectrum of {white}, and the "
        f"mean reflectance is {100 * scene.reflectance:g} %"
    )
    say(
        f"pictures: {settings.trajectory.frames} frames of {camera.width} × {camera.height} px at "
        f"{settings.trajectory.frame_rate_hz:.6g} Hz from {found.pictures} pictures; {light}"
    )
    if found.pictures == 1:
        say("pictures: it is one picture, which stands still")
    for note in found.notes:
        say(f"pictures: {note}")
    if found.saturated:
        share = f"{100 * found.saturated:.2g} % of the pixels"
        say(f"pictures: {share} are saturated in the file, so too dark")


def check_pictures(settings: Configuration) -> None:
    """Refuse, with ValueError, pictures of another shape than the frames."""
    path, camera = _scene(settings).file.path, settings.camera
    if not Path(path).exists():
        return  # a dataset that came from elsewhere
    rows, columns = measured(settings).shape
    if abs(camera.height - camera.width * rows / columns) > 1:
        raise ValueError(
            f"camera {camera.width} × {camera.height}: {path} has {columns} × {rows} px; give a "
            "size of the same shape"
        )
