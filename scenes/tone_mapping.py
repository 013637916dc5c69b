"""Radiance as a display picture: white balanced, and exposed for the scene at any light level.

Only light sources may clip, but the sky is a hundred times as bright as shaded objects before it.
So dark values are kept and bright ones compressed, up to the brightest, which is white: x·(1 +
x/w²)/(1 + x), with w the brightest (Reinhard et al., SIGGRAPH 2002, Eq. 4).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.color import Bands, encode_srgb, linear_srgb
from megalopta.scenes.spectra.spectrum import Spectrum

# The level is the brightest tenth, or less if an open sky would leave the ground dark.
_LEVEL_PERCENTILE = 90.0
_LEVEL_OVER_MEDIAN = 8.0


@dataclass(frozen=True)
class ToneCurve:
    """Mapping of linear values to fractions of white."""

    level: float
    """Values far below it are only divided by it."""
    brightest: float
    """Value that becomes white, as do all above; at least the level."""

    @classmethod
    def of(cls, images: Iterable[NDArray[np.floating]]) -> "ToneCurve":
        """Return a curve exposed for the first of some linear images that clips no value."""
        level = brightest = 0.0
        for image in images:
            if not level:
                bright, middle = np.percentile(image, [_LEVEL_PERCENTILE, 50])
                level = float(min(bright, _LEVEL_OVER_MEDIAN * middle))
            brightest = max(brightest, float(image.max()))
        level = level or brightest or 1.0
        return cls(level, max(level, brightest))

    def __call__(self, linear: NDArray[np.floating]) -> Floats:
        """Fractions of white, 0 to 1, of linear values."""
        x, most = np.asarray(linear / self.level, np.float64), self.brightest / self.level
        return np.minimum(x * (1 + x / most**2) / (1 + x), 1)


def preview(
    radiance: NDArray[np.floating], bands_nm: Bands, white: Spectrum, curve: ToneCurve | None = None
) -> NDArray[np.uint8]:
    """Picture (H, W, 3) of band-mean radiance (H, W, B); the spectrum `white` becomes neutral.

    The curve defaults to that of this picture.
    """
    linear = linear_srgb(radiance, bands_nm, white)
    return encode_srgb((curve or ToneCurve.of([linear]))(linear))
