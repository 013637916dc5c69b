"""Surfaces that reflect, transmit or emit light; others than diffuse are Mitsuba plug-ins."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen.plants.foliage import ATLAS_TILES, TONES
from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.color import KNOWN_NM
from megalopta.scenes.spectra.spectrum import Spectrum, common_range, flat, total

LAST_NM: Mapping[str, float] = {
    **dict.fromkeys(("Cu_palik", "HgTe", "SiC", "TiC", "TiN", "VC", "VN"), 826.5),
    **{"AlSb": 590.3, "Li": 751.3, "MgO": 767.6, "Se": 688.7, "Se-e": 688.7, "ThF4": 799.8},
    "d-C": 656.2,
}
"""Last wavelength of Mitsuba's data on metals that end before 830 nm, also of NAME_palik."""

SURFACES = (
    *("conductor", "roughconductor", "dielectric", "roughdielectric", "thindielectric"),
    *("plastic", "roughplastic", "principled", "diffuse", "twosided", "mask", "blendbsdf"),
    *("bumpmap", "normalmap"),
)
"""Mitsuba's types of surfaces that are kept as they are."""
TEXTURES = "bitmap", "checkerboard"
"""Types of their textures."""


@dataclass(frozen=True)
class Rgb:
    """Color in linear sRGB, which Mitsuba makes a spectrum."""

    values: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Finish:
    """Plug-in of Mitsuba with its parameters."""

    kind: str
    """Its type, such as "roughconductor"."""
    parts: Mapping[str, "Part"]
    """Parameters by name: pictures (H, W, C) with row 0 at v = 0, and maps (4, 4) of coordinates,
    are arrays."""

    def tree(self) -> "Iterator[Finish]":
        """Yield the plug-in and all below it."""
        yield self
        for part in self.parts.values():
            if isinstance(part, Finish):
                yield from part.tree()

    @property
    def is_patterned(self) -> bool:
        """True if it needs meshes with uv coordinates."""
        return any(plug_in.kind in TEXTURES for plug_in in self.tree())

    @property
    def known_nm(self) -> tuple[float, float] | None:
        """Lowest and highest wavelength at which all of it is known; None: at all."""
        spans = [span for plug_in in self.tree() for span in plug_in._spans()]
        if not spans:
            return None
        return max(low for low, _ in spans), min(high for _, high in spans)

    def _spans(self) -> Iterator[tuple[float, float]]:
        if self.kind == "bitmap" and self.parts.get("raw") is not True:
            yield KNOWN_NM
        for name, part in self.parts.items():
            if isinstance(part, Rgb):
                yield KNOWN_NM
            elif isinstance(part, Spectrum) and len(part.values) > 1:
                yield part.wavelengths_nm[0], part.wavelengths_nm[-1]
            elif name == "material" and part not in ("none", ""):
                metal = str(part)
                last = LAST_NM.get(metal, LAST_NM.get(metal.removesuffix("_palik"), KNOWN_NM[1]))
                yield KNOWN_NM[0], last


Part: TypeAlias = bool | int | float | str | Rgb | Spectrum | NDArray[np.float32] | Floats | Finish
"""Value of a parameter."""


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
        return tuple((reflectance, None) for reflectance in self.reflectances)


INTERFACE = 0.035
"""Share of light that the surface of a leaf reflects, before pigments take part: PROSPECT's mean in
a cone of 40° for a refractive index of 1.45; its tables are no lower in the visible."""
BLADES = ATLAS_TILES, ATLAS_TILES * TONES
"""Leaves that the texture of a glossy material shows side by side, and one above the other."""

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
    gloss: float | None = None
    """RMS slope of the facets of leaves whose interface reflects `INTERFACE` of the light as a
    mirror would, at random tilts, and not in all directions; None: it does. Both sides do."""

    def __post_init__(self) -> None:
        """Reject a surface that would return more light than it receives."""
        _check_energy("material", self.reflectance, self.transmittance)

    @property
    def body(self) -> "Material":
        """What is diffuse of it: without the interface of glossy leaves."""
        if self.gloss is None:
            return self
        texture = self.texture
        if isinstance(texture, Texture):
            texture = replace(texture, reflectance=_below(texture.reflectance))
        return replace(self, reflectance=_below(self.reflectance), texture=texture)

    @property
    def range_nm(self) -> tuple[float, float]:
        """Lowest and highest wavelength at which it is known."""
        known = [Spectrum((550.0,), (0.0,), self.known_nm)]
        if self.emission and isinstance(self.emission.radiance, Spectrum):
            known.append(self.emission.radiance)
        elif not (self.emission or self.finish):
            of_texture = self.texture.spectra if self.texture else ()
            parts = (self.reflectance, self.transmittance), *of_texture
            known += [part for pair in parts for part in pair if part]
        return common_range(known)

    @property
    def transmits(self) -> bool:
        """True if it transmits light anywhere."""
        of_texture = [through for _, through in self.texture.spectra] if self.texture else []
        spectra = self.transmittance, *of_texture
        return not self.emission and any(
            spectrum and max(spectrum.values) > 0 for spectrum in spectra
        )


def _below(reflectance: Spectrum) -> Spectrum:
    values = tuple(max(value - INTERFACE, 0.0) for value in reflectance.values)
    return replace(reflectance, values=values)


def _check_energy(surface: str, reflectance: Spectrum, transmittance: Spectrum | None) -> None:
    """Raise ValueError if a surface returns more light than falls on it."""
    through = transmittance or flat(0.0)
    # Both are linear between these.
    wavelengths = np.union1d(reflectance.wavelengths_nm, through.wavelengths_nm)
    shares = reflectance(wavelengths) + through(wavelengths)
    worst = int(shares.argmax())
    if shares[worst] > 1 + 1e-6:  # rounding
        raise ValueError(
            f"{surface}: reflectance and transmittance add up to {shares[worst]:.4g} at "
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
