"""A photographed panorama as the light of a scene: an uneven sky of three colors, and a disc.

A sun that stands in the picture is a few of its pixels and much of its light. It is taken out and
made the scene's disc, which casts sharp shadows at no noise: what lies within 3° of the brightest
pixel, over the mean of the ring around it, if that is at least a twentieth of the light of the
upper half.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from megalopta.render.environment import Floats, horizontal, load_panorama
from megalopta.scenes.scene import (
    Environment,
    Lighting,
    Scene,
    SkyPattern,
    Sun,
    pattern_directions,
)
from megalopta.scenes.spectra.photometry import luminous
from megalopta.scenes.spectra.spectrum import total

DISC_DEG, RING_DEG = 3.0, 6.0
"""Angles from the brightest pixel: what belongs to the disc, and to the sky around it (degrees)."""
LEAST_SHARE = 0.05
"""Of the light of the upper half; less stays in the picture."""


def under_panorama(scene: Scene) -> Scene:
    """Return the scene with the picture that lights it read, if there is one.

    Raises ValueError when it cannot be read.
    """
    if scene.lighting is None or scene.lighting.panorama is None:
        return scene
    return replace(scene, lighting=_lighting(scene.lighting, scene.lighting.panorama))


def _lighting(lighting: Lighting, panorama: Environment) -> Lighting:
    picture = turned(load_panorama(panorama), panorama.turn_deg)
    weights = np.array([luminous(spectrum) for spectrum in panorama.spectra])
    picture, direction, irradiance = without_disc(picture, weights)
    colors = zip(panorama.spectra, np.moveaxis(picture, -1, 0), strict=True)
    patterns = [SkyPattern(spectrum, np.ascontiguousarray(color)) for spectrum, color in colors]
    sun = lighting.sun
    if irradiance.any():
        parts = zip(panorama.spectra, irradiance.tolist(), strict=True)
        sun = Sun(direction, total([spectrum.scaled(factor) for spectrum, factor in parts]))
    return replace(lighting, sun=sun, patterns=(*lighting.patterns, *patterns), panorama=None)


def turned(picture: Floats, turn_deg: float) -> Floats:
    """Return the picture (H, 2·H, 3) turned counterclockwise seen from above."""
    columns = turn_deg / 360 * picture.shape[1]
    whole = int(np.floor(columns))
    part = np.float32(columns - whole)
    near = np.roll(picture, -whole, axis=1)
    return near if not part else (1 - part) * near + part * np.roll(near, -1, axis=1)


def without_disc(
    picture: Floats, weights: NDArray[np.float64]
) -> tuple[Floats, tuple[float, float, float], NDArray[np.float64]]:
    """Take the disc of sun or moon out of a picture.

    Parameters
    ----------
    picture : (H, 2·H, 3)
        Radiance of each color, in the layout of `SkyPattern`.
    weights : (3,)
        What the colors count.

    Returns
    -------
    picture : (H, 2·H, 3)
        With the ring's mean in place of the disc.
    direction : (3,)
        Unit vector toward the disc's center.
    irradiance : (3,)
        Of each color on a plane that faces the disc; zeros where there is none.
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


def solid_angles(rows: int, columns: int) -> NDArray[np.float64]:
    """Solid angle (H,) of a pixel of each row."""
    return np.asarray(-np.diff(np.cos(np.pi * np.arange(rows + 1) / rows)) * 2 * np.pi / columns)
