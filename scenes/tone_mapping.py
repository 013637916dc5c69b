"""Radiance as a picture for people: white balanced, exposed for the scene, whatever its light.

What is no light source must not clip, and the sky is a hundred times as bright as what stands in
the shade before it. So dark values stay as they are and bright ones are pressed together, up to the
brightest, which is white: x·(1 + x/w²)/(1 + x), with w of the brightest (Reinhard et al., SIGGRAPH
2002, Eq. 4).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.color import Bands, encode_srgb, linear_srgb
from megalopta.scenes.spectra.spectrum import Spectrum

# The level is the brightest tenth, or less where an open sky would leave the ground in the dark.
_LEVEL_PERCENTILE = 90.0
_LEVEL_OVER_MEDIAN = 8.0


@dataclass(frozen=True)
class ToneCurve:
    """How linear values become parts of white."""

    level: float
    """Values far below it are divided by it, and no more."""
    brightest: float
    """Comes out white, and so does all above; the level or more."""

    @classmethod
    def of(cls, images: Iterable[NDArray[np.floating]]) -> "ToneCurve":
        """Exposed for the first of some images of linear values, with no value of any clipped."""
        level = brightest = 0.0
        for image in images:
            level = level or _level(image)
            brightest = max(brightest, float(image.max()))
        level = level or brightest or 1.0
        return cls(level, max(level, brightest))

    def __call__(self, linear: NDArray[np.floating]) -> Floats:
        """Parts of white, 0 to 1, of linear values."""
        x, most = np.asarray(linear / self.level, np.float64), self.brightest / self.level
        return np.minimum(x * (1 + x / most**2) / (1 + x), 1)


def preview(
    radiance: NDArray[np.floating], bands_nm: Bands, white: Spectrum, curve: ToneCurve | None = None
) -> NDArray[np.uint8]:
    """Picture (H, W, 3) of band-mean radiance (H, W, B); the spectrum `white` comes out neutral.

    The curve is by default that of this picture.
    """
    linear = linear_srgb(radiance, bands_nm, white)
    return encode_srgb((curve or ToneCurve.of([linear]))(linear))


def _level(linear: NDArray[np.floating]) -> float:
    bright, middle = np.percentile(linear, [_LEVEL_PERCENTILE, 50])
    return float(min(bright, _LEVEL_OVER_MEDIAN * middle))
