"""What meshes send out of the light that falls on either of their sides.

A side of a diffuse surface sends out (ρ·E + τ·E′)/π, where E is the irradiance of this side and E′
that of the other. Rays are shared between the sides about as ρ is to τ, which leaves the least
noise where both are lit alike.
"""

from collections.abc import Sequence

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.render import Bands
from megalopta.scenes.material import Material
from megalopta.scenes.spectra.spectrum import Spectrum, flat

WAVELENGTHS = 2**8
"""In a band, of which each path takes one."""
_LEAST_SHARE = 0.25
"""Of the rays that either side of what lets light through gets: bands differ."""


def scattered(material: Material) -> tuple[Spectrum, Spectrum, Spectrum, Spectrum]:
    """Reflectance where the texture's weight is 0 and where it is 1, and so transmittance."""
    black, texture = flat(0.0), material.texture
    if material.emission:
        return black, black, black, black
    first = material.reflectance, material.transmittance or black
    second = (texture.reflectance, texture.transmittance or black) if texture else first
    return first[0], second[0], first[1], second[1]


class Scattering:
    """Of M materials: what B bands get of the light on this side (0) and on the other (1)."""

    def __init__(self, materials: Sequence[Material], bands_nm: Bands) -> None:
        places = (np.arange(WAVELENGTHS) + 0.5) / WAVELENGTHS
        self._grids = [lower + (upper - lower) * places for lower, upper in bands_nm]
        table = [
            [[each(grid) for grid in self._grids] for each in scattered(material)]
            for material in materials
        ]
        self._table = np.reshape(table, (len(materials), 2, 2, len(bands_nm), WAVELENGTHS))
        means = self._table.mean(axis=(2, 3, 4))
        total = means.sum(axis=1)
        through = np.divide(means[:, 1], total, out=np.zeros(len(total)), where=total > 0)
        through = np.where(through > 0, through.clip(_LEAST_SHARE, 1 - _LEAST_SHARE), 0)
        self.through: Floats = through
        """(M,): share of the rays that leave from the other side."""
        shares = np.stack([1 - through, through], axis=1)
        self._weight = np.divide(1, shares, out=np.zeros_like(shares), where=shares > 0)

    def of_rays(self) -> Floats:
        """What a ray counts (M, 2 sides, 2 spectra, B, WAVELENGTHS) of the light that it brings."""
        return np.asarray(self._table * self._weight[:, :, None, None, None])

    def under(self, skies: Sequence[Spectrum]) -> Floats:
        """Radiance (M, 2 sides, S, 2 spectra · B) that each side's share of S skies brings.

        Divided by the share of rays that the side gets.
        """
        each = [self._under(sky) * self._weight[:, :, None] for sky in skies]
        return np.stack(each, axis=2)

    def brightness(self, sky: Spectrum) -> Floats:
        """How bright (M,) materials are under the sky, relative to the brightest; 1 in the dark."""
        total = self._under(sky).sum(axis=(1, 2))
        return np.asarray(total / total.max() if total.any() else np.ones(len(total)))

    def _under(self, sky: Spectrum) -> Floats:
        light = np.array([sky(grid) for grid in self._grids])
        return np.asarray(np.mean(self._table * light, axis=-1)).reshape(len(self._table), 2, -1)
