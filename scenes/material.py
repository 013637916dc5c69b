"""What surfaces do with light: reflect it, let it through, or send out their own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.scenes.spectra.spectrum import Spectrum, flat

_ROUNDING = 1e-6


@dataclass(frozen=True)
class Texture:
    """A second reflectance mixed in: (1 − w)·reflectance + w·texture.reflectance.

    And so a second transmittance.
    """

    weight: NDArray[np.float32]
    """(H, W), 0 to 1: tiles over the uv square; row 0 is v = 0."""
    reflectance: Spectrum
    """Reached where the weight is 1."""
    transmittance: Spectrum | None = None
    """Reached where the weight is 1; None lets nothing through there."""

    def __post_init__(self) -> None:
        """Refuse what would send out more light than it gets."""
        _check_energy("texture", self.reflectance, self.transmittance)


@dataclass(frozen=True)
class Material:
    """A diffuse surface, alike on both sides, or one that emits.

    What falls on one side leaves it evenly (Lambert), and the other side too where light comes
    through.
    """

    reflectance: Spectrum
    """Diffuse reflectance, 0 to 1."""
    texture: Texture | None = None
    """Needs meshes with uv coordinates."""
    emission: "Emission | None" = None
    """Makes the surface a source; reflectance and transmittance are then ignored."""
    transmittance: Spectrum | None = None
    """Diffuse transmittance, with the reflectance at most 1; None is opaque."""

    def __post_init__(self) -> None:
        """Refuse what would send out more light than it gets."""
        _check_energy("material", self.reflectance, self.transmittance)

    @property
    def transmits(self) -> bool:
        """Whether light comes through anywhere."""
        spectra = self.transmittance, self.texture.transmittance if self.texture else None
        return not self.emission and any(each and max(each.values) > 0 for each in spectra)


def _check_energy(what: str, reflectance: Spectrum, transmittance: Spectrum | None) -> None:
    """Raise ValueError where a surface sends out more light than falls on it."""
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
    """Radiance leaving a surface, the same at every wavelength: pattern(u, v) · radiance."""

    radiance: float
    """W·m⁻²·sr⁻¹·nm⁻¹ where the pattern is 1."""
    pattern: NDArray[np.float32] | None = None
    """(H, W): non-negative factor over the uv square; row 0 is v = 0. None means 1."""
