"""Light of somebody's pictures: frames at the rate and size of a sequence, as radiance."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast
from weakref import finalize

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.config.model import Configuration
from megalopta.core import files
from megalopta.core.arrays import Floats
from megalopta.core.bounded import undamaged
from megalopta.core.errors import refused_as
from megalopta.dataset.store import Dataset
from megalopta.scenes import Light, Pictures
from megalopta.scenes.spectra.color import LUMINANCE_SHARES, Bands, encode_srgb
from megalopta.sensor import ImageSensor, photon_rate

if TYPE_CHECKING:
    from megalopta.render import Footage

Float32 = NDArray[np.float32]

_SAME_TIME = 0.1
"""Share of the period of frames, or pictures, by which times of a file may be rounded"""


class PictureFrames:
    """Linear light (H, W, 3) of pictures at any place of a sequence; places count frames from 0.

    Raises ValueError for pictures of another shape than the frames.
    """

    def __init__(self, footage: "Footage", settings: Configuration) -> None:
        camera, (rows, columns) = settings.camera, footage.shape
        if abs(camera.height - camera.width * rows / columns) > 1:
            raise ValueError(
                f"camera {camera.width} × {camera.height}: {footage.path} has {columns} × {rows} "
                "px; give a size of the same shape"
            )
        self.footage, self.settings = footage, settings
        scene, rate_hz = cast(Pictures, settings.scene), settings.trajectory.frame_rate_hz
        self.times_s = picture_times(footage, scene.picture_rate_hz or rate_hz)
        self._between, self._places = scene.between, self.times_s * rate_hz
        steps = np.diff(self._places)
        self._same = _SAME_TIME * min(1.0, float(np.median(steps)) if steps.size else 1.0)
        shape = camera.height, camera.width
        self._picture: Callable[[int], Float32] = lru_cache(maxsize=3)(
            lambda index: resized(footage.frame(index), shape)
        )
        self._flow: Callable[[int], Floats] = lru_cache(maxsize=1)(
            lambda before: clean_flow(self._picture(before), self._picture(before + 1))
        )

    def at(self, place: float | Floats) -> Float32:
        """Return the light at a place of the sequence, or that of every row at its own, (H, 1)."""
        if not isinstance(place, np.ndarray) or place.ndim == 0:
            return self._mixed(*self._neighbors(float(place)))
        neighbors = np.array([self._neighbors(row) for row in place.ravel().tolist()])
        starts, shares = np.hsplit(neighbors, 2)
        light: Any = 0.0
        for before in np.unique(starts):
            rows = starts == before
            light = np.where(rows[..., np.newaxis], self._mixed(int(before), rows * shares), light)
        return np.asarray(light)

    def _mixed(self, before: int, share: float | Floats) -> Float32:
        """Return the light at a share of the way from one picture to the next."""
        first = self._picture(before)
        if not np.any(share):
            return first
        second = self._picture(before + 1)
        if self._between == "blend":
            weight = np.asarray(share, np.float32)[..., np.newaxis]
            return np.asarray(first + weight * (second - first))
        from megalopta.sensor.shot import NextFrames

        flow = self._flow(before)[np.newaxis]
        following = NextFrames(
            radiance=second[np.newaxis], flow=flow, hidden=np.zeros(flow.shape[:3], np.bool_)
        )
        moved = following.between(first[np.newaxis], 0, np.asarray(share)[np.newaxis])
        return np.asarray(moved[0], np.float32)

    def _neighbors(self, place: float) -> tuple[int, float]:
        """Return the picture at or before a place, and the share of the way to the next."""
        last = len(self._places) - 1
        index = int(np.searchsorted(self._places, place + self._same, side="right")) - 1
        before = min(max(index, 0), last)
        if self._between == "hold" or before == last:
            return before, 0.0
        start, end = self._places[before : before + 2]
        share = (place - start) / (end - start)
        return before, 0.0 if place - start < self._same else min(share, 1.0)

    def weights(self) -> dict[int, float]:
        """Return how often each picture is seen in the frames of the sequence, parts of it added.

        Where light moves along a flow, as if pictures were blended.
        """
        weights: dict[int, float] = {}
        for place in range(self.settings.trajectory.frames):
            before, share = self._neighbors(place)
            weights[before] = weights.get(before, 0.0) + 1 - share
            if share:
                weights[before + 1] = weights.get(before + 1, 0.0) + share
        return weights


def resized(picture: Float32, shape: tuple[int, int]) -> Float32:
    """Return a picture (H, W, 3) of a shape; each pixel of a smaller one is a mean."""
    import cv2

    if picture.shape[:2] == shape:
        return picture
    how = cv2.INTER_AREA if picture.shape[0] > shape[0] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, shape[::-1], interpolation=how), np.float32)


def clean_flow(first: Float32, second: Float32) -> Floats:
    """Return the flow (H, W, 2) that DIS finds between two pictures (H, W, C) without noise.

    NaN where pictures are too small for it.
    """
    from megalopta.flow import optical_flow

    brightest = max(float(first.max()), float(second.max())) or 1.0
    channels = first.shape[-1]
    shares = LUMINANCE_SHARES if channels == 3 else np.full(channels, 1 / channels)
    shares = np.asarray(shares, np.float32) / brightest
    try:
        return optical_flow(encode_srgb(first @ shares), encode_srgb(second @ shares), method="DIS")
    except ValueError:
        return np.full((*first.shape[:2], 2), np.nan)


def photons_per_lux(
    radiance_of_unit: Floats, light: Light, bands_nm: Bands, sensor: ImageSensor, mean: ArrayLike
) -> float:
    """Return the mean photons on a pixel in an exposure, for each lux on the scene.

    `mean` (channels,) is the mean over all frames, of which `radiance_of_unit` gives the light.
    """
    radiance = np.asarray(mean) @ radiance_of_unit
    with refused_as(sensor.name):
        hz = photon_rate(radiance[np.newaxis, np.newaxis, np.newaxis], bands_nm, sensor)
    return float(hz[0, 0, 0]) * sensor.exposure_s / light.resolved().illuminance_lux


def picture_times(footage: "Footage", rate_hz: float) -> Floats:
    """Return the time of every picture, s; those of files that tell none follow at a rate."""
    if footage.times_s is not None:
        return footage.times_s
    return np.arange(footage.count) / rate_hz


@dataclass(frozen=True)
class Brightness:
    """Brightness of the frames of a sequence of pictures."""

    mean: tuple[float, ...]
    """Mean of linear red, green and blue over all frames, or of each channel of spectra"""
    saturated: float
    """Share of pixels at the largest code of any color"""
    luminance: float
    """Mean luminance, in the unit of the linear values; of spectra cd/m²"""


@dataclass(frozen=True)
class PictureLight:
    """Frames of pictures as spectral radiance (H, W, B), W·m⁻²·sr⁻¹·nm⁻¹."""

    frames: PictureFrames
    brightness: Brightness
    radiance_of_unit: Floats
    """(channels, B): of each channel, such as red, with the value 1"""

    def at(self, place: float | Floats) -> Float32:
        """Return the radiance at a place of the sequence, whose frames count from 0.

        Of every row at its own, with places (H, 1).
        """
        return np.asarray(self.frames.at(place) @ self.radiance_of_unit.astype(np.float32))


@dataclass(frozen=True)
class NextPictures:
    """Light of pictures between two frames (`sensor.sub_frames.Following`)."""

    light: PictureLight
    first: int
    """Number of the first of the frames"""
    factor: NDArray[np.floating]
    """(B,)"""

    def scaled(self, factor: NDArray[np.floating]) -> "NextPictures":
        """The same light, so many times as bright."""
        return NextPictures(self.light, self.first, self.factor * factor)

    def between(self, _: NDArray[np.floating], frame: int, shares: Floats) -> NDArray[np.floating]:
        """Return the radiance (S, H, W, B) at shares of the way from one of the frames on."""
        places = self.first + frame + shares
        return np.stack([self.light.at(place) * self.factor for place in places])


_last_opened: list[tuple[Dataset, PictureLight]] = []
"""Dataset of pictures that was opened last"""


def light_of(dataset: Dataset) -> PictureLight:
    """Return the light of a dataset's pictures, whose files are compared when they are opened.

    Raises UserError when they, or their record, are damaged.
    """
    if dataset.light:
        return dataset.light
    for last, light in _last_opened:
        if last.root == dataset.root and last.configuration is dataset.configuration:
            return light
    _last_opened[:] = [(dataset, _opened(dataset))]
    return _last_opened[0][1]


def _opened(dataset: Dataset) -> PictureLight:
    from megalopta.render import open_footage

    settings, folder = dataset.configuration, picture_folder(dataset)
    with undamaged(folder, f"run: {dataset.render_again}"):
        dataset.compare_all(f"{folder.relative_to(dataset.root).as_posix()}/")
        recorded = dataset.read_scene_record()["pictures"]
        brightness = Brightness(
            tuple(np.array(recorded["mean"], np.float64).ravel().tolist()),
            float(recorded["saturated"]),
            float(recorded["luminance"]),
        )
        (source,) = (path for path in folder.iterdir() if not files.is_temporary(path))
    scene = cast(Pictures, settings.scene)
    with refused_as(str(folder)):
        frames = PictureFrames(open_footage(source, scene.unit), settings)
    finalize(frames, frames.footage.close)
    of_unit = scene.radiance_of_unit(
        settings.light, settings.render.bands_nm, brightness.mean, frames.footage.bands_nm
    )
    return PictureLight(frames, brightness, of_unit)


def picture_folder(dataset: Dataset) -> Path:
    """Folder that holds the pictures of a dataset: a file, or a folder of files."""
    return dataset.root / "pictures" / dataset.sequence
