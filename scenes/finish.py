"""Surfaces that are not diffuse, as the tree of Mitsuba's plug-ins that describes them.

They are kept as a file states them; only the renderer knows what they do to light.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.color import KNOWN_NM
from megalopta.scenes.spectra.spectrum import Spectrum

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
_BARE = "none", ""


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
        return any(each.kind in TEXTURES for each in self.tree())

    @property
    def known_nm(self) -> tuple[float, float] | None:
        """Lowest and highest wavelength at which all of it is known; None: at all."""
        spans = [span for each in self.tree() for span in each._spans()]
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
            elif name == "material" and part not in _BARE:
                metal = str(part)
                last = LAST_NM.get(metal, LAST_NM.get(metal.removesuffix("_palik"), KNOWN_NM[1]))
                yield KNOWN_NM[0], last


Part: TypeAlias = bool | int | float | str | Rgb | Spectrum | NDArray[np.float32] | Floats | Finish
"""Value of a parameter."""
