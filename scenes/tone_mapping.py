"""Radiance as a picture for people: white balanced, exposed for the scene, whatever its light."""

import numpy as np
from numpy.typing import NDArray

from megalopta.scenes.base import SceneDescription
from megalopta.scenes.lighting import Light
from megalopta.scenes.spectra import Bands, Spectrum, encode_srgb, flat, linear_srgb

# White is the brightest tenth, or less where an open sky would leave the ground in the dark.
_WHITE_PERCENTILE = 90.0
_WHITE_OVER_MEDIAN = 8.0


def white_of(scene: SceneDescription, light: Light) -> Spectrum:
    """Spectrum that comes out neutral: that of the light, flat in a scene that glows by itself."""
    return flat(1.0) if scene.is_self_luminous else light.resolved().spectrum()


def white_level(linear: NDArray[np.floating]) -> float:
    """Linear value to show as white."""
    bright, middle = np.percentile(linear, [_WHITE_PERCENTILE, 50])
    return float(min(bright, _WHITE_OVER_MEDIAN * middle)) or float(linear.max()) or 1.0


def preview(
    radiance: NDArray[np.floating], bands_nm: Bands, white: Spectrum, level: float | None = None
) -> NDArray[np.uint8]:
    """Picture (H, W, 3) of band-mean radiance (H, W, B); the spectrum `white` comes out neutral.

    `level` is the linear value to show as white, by default that of this picture.
    """
    linear = linear_srgb(radiance, bands_nm, white)
    return encode_srgb(linear / (level or white_level(linear)))
