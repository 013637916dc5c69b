"""Surfaces that reflect, transmit or emit light."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.scenes.finish import Finish
from megalopta.scenes.spectra.spectrum import Spectrum, common_range, flat, total

_ROUNDING = 1e-6


@dataclass(frozen=True)
class Texture:
    """Second reflectance mixed in: (1 − w)·reflectance + w·texture.reflectance.

    Transmittances are mixed alike.
    """

    weight: NDArray[np.float32]
    """(H, W), 0 to 1: tiles over the uv square; row 0 is v = 0."""
    reflectance: Spectrum
    """Reflectance where the weight is 1."""
    transmittance: Spectrum | None = None
    """Transmittance where the weight is 1; None: opaque there."""

    def __post_init__(self) -> None:
        """Reject a texture that would return more light than it receives."""
        _check_energy("texture", self.reflectance, self.transmittance)

    @property
    def spectra(self) -> "tuple[_Scattered, ...]":
        """Reflectance and transmittance where the weight is 1."""
        return ((self.reflectance, self.transmittance),)


@dataclass(frozen=True)
class ColorTexture:
    """Reflectance that is a sum of three, each with its own weight: red, green and blue."""

    weight: NDArray[np.float32]
    """(H, W, 3), 0 to 1: tiles over the uv square; row 0 is v = 0."""
    reflectances: tuple[Spectrum, Spectrum, Spectrum]
    """Reflectances where the weights are 1."""

    def __post_init__(self) -> None:
        """Reject a texture that would return more light than it receives."""
        _check_energy("texture", total(self.reflectances), None)

    @property
    def spectra(self) -> "tuple[_Scattered, ...]":
        """Reflectance where each weight is 1; it is opaque."""
        return tuple((each, None) for each in self.reflectances)


_Scattered = tuple[Spectrum, Spectrum | None]


@dataclass(frozen=True)
class Material:
    """Diffuse surface, equal on both sides, or an emitter, or one with a finish.

    Light that falls on a diffuse side leaves it as from a Lambertian surface, and the other side if
    it transmits.
    """

    reflectance: Spectrum
    """Diffuse reflectance, 0 to 1."""
    texture: Texture | ColorTexture | None = None
    """Mixed-in texture, or one of colors on a black surface; needs meshes with uv coordinates."""
    emission: "Emission | None" = None
    """Emission of a source; reflectance and transmittance are then ignored."""
    transmittance: Spectrum | None = None
    """Diffuse transmittance, with the reflectance at most 1; None: opaque."""
    known_nm: tuple[float, float] | None = None
    """Lowest and highest wavelength at which its spectra are known; None: at all."""
    finish: Finish | None = None
    """Surface that is not diffuse, or that of a lamp; of all others only `emission` and `known_nm`
    then count."""

    def __post_init__(self) -> None:
        """Reject a surface that would return more light than it receives."""
        _check_energy("material", self.reflectance, self.transmittance)
        is_bare = not (self.transmits or any(self.reflectance.values))
        if isinstance(self.texture, ColorTexture) and not is_bare:
            raise ValueError(
                "material: a texture of colors has all of the reflectance; use a reflectance of 0 "
                "and no transmittance"
            )

    @property
    def range_nm(self) -> tuple[float, float]:
        """Lowest and highest wavelength at which it is known."""
        known = [Spectrum((550.0,), (0.0,), self.known_nm)]
        if self.emission:
            known += (
                [self.emission.radiance] if isinstance(self.emission.radiance, Spectrum) else []
            )
        elif not self.finish:
            of_texture = self.texture.spectra if self.texture else ()
            parts = (self.reflectance, self.transmittance), *of_texture
            known += [part for pair in parts for part in pair if part]
        return common_range(known)

    @property
    def transmits(self) -> bool:
        """True if it transmits light anywhere."""
        of_texture = [through for _, through in self.texture.spectra] if self.texture else []
        spectra = self.transmittance, *of_texture
        return not self.emission and any(each and max(each.values) > 0 for each in spectra)


def _check_energy(what: str, reflectance: Spectrum, transmittance: Spectrum | None) -> None:
    """Raise ValueError if a surface returns more light than falls on it."""
    through = transmittance or flat(0.0)
    # Both are linear between these.
    wavelengths = np.union1d(reflectance.wavelengths_nm, through.wavelengths_nm)
    shares = reflectance(wavelengths) + through(wavelengths)
    worst = int(shares.argmax())
    if shares[worst] > 1 + _ROUNDING:
        raise ValueError(
            f"{what}: reflectance and transmittance add up to {shares[worst]:.4g} at "
            f"{wavelengths[worst]:g} nm; scale them to at most 1"
        )


@dataclass(frozen=True)
class Emission:
    """Radiance that leaves a surface: pattern(u, v) · radiance."""

    radiance: float | Spectrum
    """Radiance where the pattern is 1, W·m⁻²·sr⁻¹·nm⁻¹; a number is the same at every wavelength,
    a spectrum has no pattern."""
    pattern: NDArray[np.float32] | None = None
    """(H, W): non-negative factor over the uv square; row 0 is v = 0. None means 1."""
