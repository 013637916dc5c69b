"""Panoramas at infinity: seen by a camera, or as light of a scene.

For a camera the picture is looked up, as the mean over a square grid of points in each pixel. As
the light of a scene it is a non-uniform sky of three colors, and a disc that casts sharp shadows
without noise: the light within 3° of the brightest pixel, above the mean of the ring around it, if
that is at least 5 % of the light of the upper half.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, bilinear
from megalopta.core.bounded import check_decoded
from megalopta.core.errors import UserError
from megalopta.core.progress import say
from megalopta.render.film import FrameExposure
from megalopta.render.footage.pictures import open_picture
from megalopta.render.noise import Image, MeasuredPass
from megalopta.render.settings import Bands
from megalopta.render.surface_view import Illuminance, LightSurvey
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.scene import Environment, Scene, SkyPattern, Sun, pattern_directions
from megalopta.scenes.spectra.color import band_means
from megalopta.scenes.spectra.spectrum import luminous, total

# Rows of points looked up at once, so that memory stays far below that of the directions.
POINTS_AT_ONCE = 2**18

_SEEN_BYTES, _LIGHT_BYTES = 55, 150
"""Memory of a pixel of a panorama that a camera sees, and of one that lights a scene (measured)."""


class EnvironmentView:
    """Camera in a panorama, ready to be turned; samples are rounded up to a square."""

    def __init__(
        self, environment: Environment, camera: Camera, bands_nm: Bands, samples: int
    ) -> None:
        self._rgb = load_panorama(environment)  # first, as it may be refused
        self._turn = math.radians(environment.turn_deg)
        self._grid = math.isqrt(samples - 1) + 1
        self._axes = camera.finer(self._grid).directions().astype(np.float32)
        self._efficacy = [luminous(spectrum) for spectrum in environment.spectra]
        self._band_means = band_means(environment.spectra, bands_nm).astype(np.float32)

    @property
    def samples_per_pixel(self) -> int:
        """Points per pixel."""
        return self._grid**2

    def radiance(self, exposure: FrameExposure) -> Image:
        """Mean spectral radiance (H, W, B) over all poses of an exposure; it has no noise."""
        poses = np.concatenate([part.poses.reshape(-1, 4, 4) for part in exposure.parts])
        step = self._grid * max(1, POINTS_AT_ONCE // (self._grid * self._axes.shape[1]))
        images = []
        for pose in poses:
            rotation = pose[:3, :3].T.astype(np.float32)
            strips = []
            for first in range(0, len(self._axes), step):
                directions = self._axes[first : first + step] @ rotation
                colors = look_up(self._rgb, directions, self._turn)
                height, width = (size // self._grid for size in directions.shape[:2])
                points = colors.reshape(height, self._grid, width, self._grid, 3)
                strips.append(points.mean(axis=(1, 3)))
            images.append(np.concatenate(strips) @ self._band_means)
        return np.asarray(np.mean(images, axis=0), np.float32)

    def measured(self, exposure: FrameExposure) -> MeasuredPass:
        """The same, without error; no pixel is marked as sky."""
        radiance = self.radiance(exposure)
        return MeasuredPass(radiance, np.zeros_like(radiance[..., 0]))

    def light_left_out(self, pose: Floats, time_s: float) -> None:
        """None: there are no surface hits."""

    def light_survey(self, positions: Floats) -> LightSurvey:
        """Illuminance by the picture's upper half; equal everywhere."""
        lux = float(horizontal(self._rgb) @ self._efficacy)
        return LightSurvey(Illuminance(tuple(positions.mean(axis=0).tolist()), lux, 0.0), ())


def look_up(rgb: Image, directions: Image, turn_rad: float = 0.0) -> Image:
    """Colors (..., 3) in directions (..., 3) of an equirectangular picture, bilinear."""
    rows, columns = rgb.shape[:2]
    azimuth = np.arctan2(directions[..., 1], directions[..., 0]) - turn_rad
    polar = np.arccos(np.clip(directions[..., 2], -1, 1))
    x = (0.5 - azimuth / (2 * math.pi)) * columns - 0.5
    y = np.clip(polar / math.pi * rows - 0.5, 0, rows - 1)
    return bilinear(rgb, x, y).astype(np.float32)


def load_panorama(environment: Environment) -> Image:
    """Read the picture (H, W, 3), scaled to give the illuminance with the given spectra.

    Raises ValueError if the file cannot be read, has changed, or is not a panorama.
    """
    path = environment.file.path
    environment.file.read()  # rejects missing or changed files
    rgb = read_picture(path)
    rows, columns = rgb.shape[:2]
    if columns != 2 * rows:
        raise ValueError(
            f"{path} has {columns} × {rows} pixels; a panorama is twice as wide as it is high"
        )
    efficacy = np.array([luminous(spectrum) for spectrum in environment.spectra])
    lux = horizontal(rgb) @ efficacy
    if lux <= 0:
        raise ValueError(f"{path} is black above the horizon; give a picture with light in it")
    return np.asarray(rgb * (environment.illuminance_lux / lux), np.float32)


def horizontal(rgb: NDArray[np.floating]) -> Floats:
    """Integral (3,) of the picture's upper half over solid angle, times the cosine to the zenith.

    A row between the polar angles a and b has the weight ∫ cos θ·sin θ dθ = (sin²b − sin²a)/2, so
    that a picture of ones gives π.
    """
    rows, columns = rgb.shape[:2]
    edges = np.clip(np.arange(rows + 1) * math.pi / rows, 0, math.pi / 2)
    weights = np.diff(np.sin(edges) ** 2) / 2 * (2 * math.pi / columns)
    return np.asarray(weights @ rgb.sum(axis=1, dtype=np.float64))


def read_picture(path: str) -> Image:
    """Return the light of a picture (H, W, 3) in linear sRGB, as the footage reader gives it.

    What the file states without effect is reported. Raises ValueError if it cannot be read.
    """
    try:
        with open_picture(Path(path), None) as footage:
            if footage.bands_nm is not None:
                raise ValueError(f"{path} holds spectra; give a panorama of red, green and blue")
            check_decoded(path, footage.shape, _SEEN_BYTES)
            for note in footage.notes:
                say(note)
            return footage.frame(0)
    except UserError as problem:
        raise ValueError(str(problem)) from None


DISC_DEG, RING_DEG = 3.0, 6.0
"""Angles from the brightest pixel of the disc, and of the sky around it (degrees)."""
LEAST_SHARE = 0.05
"""Smallest share of a disc in the light of the upper half; less stays in the picture."""


def under_panorama(scene: Scene) -> Scene:
    """Return the scene with the picture that lights it loaded, if there is one.

    Raises ValueError if it cannot be read.
    """
    lighting = scene.lighting
    if lighting is None or (panorama := lighting.panorama) is None:
        return scene
    loaded = load_panorama(panorama)
    check_decoded(panorama.file.path, loaded.shape[:2], _LIGHT_BYTES)
    # Turned counterclockwise seen from above.
    columns = panorama.turn_deg / 360 * loaded.shape[1]
    part = np.float32(columns - math.floor(columns))
    picture = np.roll(loaded, -math.floor(columns), axis=1)
    if part:
        picture = (1 - part) * picture + part * np.roll(picture, -1, axis=1)
    weights = np.array([luminous(spectrum) for spectrum in panorama.spectra])
    picture, direction, irradiance = without_disc(picture, weights)
    colors = zip(panorama.spectra, np.moveaxis(picture, -1, 0), strict=True)
    patterns = [SkyPattern(spectrum, np.ascontiguousarray(color)) for spectrum, color in colors]
    sun = lighting.sun
    if irradiance.any():
        parts = zip(panorama.spectra, irradiance.tolist(), strict=True)
        sun = Sun(direction, total([spectrum.scaled(factor) for spectrum, factor in parts]))
    skies = *lighting.patterns, *patterns
    return replace(scene, lighting=replace(lighting, sun=sun, patterns=skies, panorama=None))


def without_disc(
    picture: Image, weights: Floats
) -> tuple[Image, tuple[float, float, float], Floats]:
    """Take the disc of sun or moon out of a picture (H, 2·H, 3), with weights of the colors (3,).

    Returns the picture with the ring's mean in place of the disc, the unit vector toward the disc's
    center, and the irradiance of each color (3,) on a plane facing it; zeros if there is none.
    """
    rows, columns = picture.shape[:2]
    bright = picture[: rows // 2] @ weights
    row, column = np.unravel_index(int(bright.argmax()), bright.shape)
    toward = pattern_directions(rows)
    cosine = np.einsum("ijk,k->ij", toward, toward[row, column])
    disc = cosine > np.cos(np.radians(DISC_DEG))
    ring = ~disc & (cosine > np.cos(np.radians(RING_DEG)))
    solid = solid_angles(rows, columns)[:, None] * np.ones(columns)
    around = np.average(picture[ring], axis=0, weights=solid[ring])
    excess = np.maximum(picture[disc] - around, 0) * solid[disc][:, None]
    irradiance = excess.sum(axis=0)
    center = (excess @ weights) @ toward[disc]
    length = float(np.linalg.norm(center))
    center = center / length if length else toward[row, column]
    share = irradiance @ weights * center[2] / (horizontal(picture) @ weights)
    if share < LEAST_SHARE:
        return picture, tuple(center.tolist()), np.zeros(3)
    left = picture.copy()
    left[disc] = np.minimum(picture[disc], around)
    return left, tuple(center.tolist()), irradiance


def solid_angles(rows: int, columns: int) -> Floats:
    """Solid angle (H,) of a pixel in each row."""
    return np.asarray(-np.diff(np.cos(np.pi * np.arange(rows + 1) / rows)) * 2 * np.pi / columns)
