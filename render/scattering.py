"""Tables of what surfaces do to light, in bands: reflection and transmission of materials.

A diffuse surface with reflectance ρ under irradiance E emits L = ρE/π in all directions, and E/π is
the mean radiance from cosine-distributed directions. A side of a translucent surface emits (ρ·E +
τ·E′)/π, with the irradiance E′ of the other side: rays are split between the sides roughly as ρ to
τ, which minimizes noise if both are lit equally.

The spectra that a texture mixes have separate band means of ρE/π, not of ρ and E: within a band,
the correlation of green leaves and green light amounts to several percent. There are two of them,
or four where a surface of the scene has a texture of colors: black, red, green and blue.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.render import Bands, dr, mi
from megalopta.scenes.material import Material
from megalopta.scenes.spectra.spectrum import Spectrum, flat

WAVELENGTHS = 2**8
"""Wavelengths in a band, of which each path takes one."""
_LEAST_SHARE = 0.25
"""Smallest share of rays for either side of a translucent surface: bands differ."""


def spectra_of(materials: Iterable[Material]) -> int:
    """Number of spectra that the textures of some materials mix, 2 at least."""
    return 1 + max((len(each.texture.spectra) for each in materials if each.texture), default=1)


def scattered(material: Material, spectra: int) -> list[Spectrum]:
    """Reflectance where the texture's weights are 0, where each is 1, and transmittance alike."""
    if material.emission:
        return [flat(0.0)] * (2 * spectra)
    first = material.reflectance, material.transmittance
    ends = [first, *(material.texture.spectra if material.texture else ())]
    ends += [first] * (spectra - len(ends))
    return [*(back for back, _ in ends), *(through or flat(0.0) for _, through in ends)]


def mixed(ends: Sequence[Any], weights: Sequence[Any]) -> Any:
    """Mean of the first value and others, each with its weight; the first has the rest."""
    first, *others = ends
    value = first
    for other, weight in zip(others, weights, strict=True):
        value = dr.fma(other, weight, dr.fma(first, -weight, value))  # of one, `dr.lerp`
    return value


class Scattering:
    """Response of M materials in B bands to light on this side (0) and on the other (1)."""

    def __init__(self, materials: Sequence[Material], bands_nm: Bands) -> None:
        self.spectra = spectra_of(materials)
        """Number of spectra that textures mix."""
        places = (np.arange(WAVELENGTHS) + 0.5) / WAVELENGTHS
        self._grids = [lower + (upper - lower) * places for lower, upper in bands_nm]
        table = [
            [[each(grid) for grid in self._grids] for each in scattered(material, self.spectra)]
            for material in materials
        ]
        shape = len(materials), 2, self.spectra, len(bands_nm), WAVELENGTHS
        self._table = np.reshape(table, shape)
        means = self._table.mean(axis=(2, 3, 4))
        total = means.sum(axis=1)
        through = np.divide(means[:, 1], total, out=np.zeros(len(total)), where=total > 0)
        through = np.where(through > 0, through.clip(_LEAST_SHARE, 1 - _LEAST_SHARE), 0)
        self.through: Floats = through
        """(M,): share of rays that leave from the other side."""
        shares = np.stack([1 - through, through], axis=1)
        self._weight = np.divide(1, shares, out=np.zeros_like(shares), where=shares > 0)

    def of_rays(self) -> Floats:
        """Weight (M, 2 sides, spectra, B, WAVELENGTHS) of the light that a ray brings."""
        return np.asarray(self._table * self._weight[:, :, None, None, None])

    def under(self, skies: Sequence[Spectrum]) -> Floats:
        """Radiance (M, 2 sides, S, spectra · B) due to each side's share of S skies.

        It is divided by the side's share of rays.
        """
        each = [self._under(sky) * self._weight[:, :, None] for sky in skies]
        return np.stack(each, axis=2)

    def brightness(self, sky: Spectrum) -> Floats:
        """Brightness (M,) of materials under the sky, relative to the brightest; 1 in the dark."""
        total = self._under(sky).sum(axis=(1, 2))
        return np.asarray(total / total.max() if total.any() else np.ones(len(total)))

    def _under(self, sky: Spectrum) -> Floats:
        light = np.array([sky(grid) for grid in self._grids])
        return np.asarray(np.mean(self._table * light, axis=-1)).reshape(len(self._table), 2, -1)


def wavelength_groups(bands_nm: Bands, place: Any) -> Iterator[tuple[int, int, Any]]:
    """Bands in groups that fit Mitsuba's four wavelengths: first band, bands, wavelengths.

    `place` is the position of the wavelength in each band, 0 to 1.
    """
    for first in range(0, len(bands_nm), 4):
        group = bands_nm[first : first + 4]
        # Unused wavelengths repeat the last band and are not read.
        padded = [*group, *[group[-1]] * (4 - len(group))]
        wavelengths = [lower + (upper - lower) * place for lower, upper in padded]
        yield first, len(group), mi.Spectrum(wavelengths)
