"""Reflectance of a material as a configuration gives it: a number, a name, or a curve of a file."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from megalopta.core import bounded
from megalopta.core.curve_file import curve_of
from megalopta.core.record import Record
from megalopta.scenes.material import Material
from megalopta.scenes.spectra.reflectance import LEAVES, REFLECTANCES, reflectance_of
from megalopta.scenes.spectra.spectrum import Spectrum, flat

Share = Annotated[float, Field(ge=0, le=1)]
NAMES = (*REFLECTANCES, *LEAVES)
"""Names of reflectances, of the forest's surfaces."""


class Curve(Record, frozen=True):
    """Reflectance over wavelength, linear between points."""

    wavelengths_nm: Annotated[tuple[float, ...], Field(min_length=2)]
    """Increasing wavelengths (nm)."""
    values: Annotated[tuple[Share, ...], Field(min_length=2)]
    """Reflectance at each wavelength (1)."""

    @model_validator(mode="after")
    def _is_a_function(self) -> "Curve":
        self.spectrum()
        return self

    def spectrum(self) -> Spectrum:
        """Return the reflectance as a spectrum. Raises ValueError if it is no function."""
        return Spectrum(self.wavelengths_nm, self.values)


def _read(given: Any, validation: ValidationInfo) -> Any:
    if isinstance(given, str) and given.lower().endswith(".csv"):
        path = bounded.named_path(given, bounded.folder_of(validation))
        with bounded.unreadable(path):
            return curve_of(bounded.read_bytes(path), str(path), "reflectance")
    is_share = isinstance(given, int | float) and 0 <= given <= 1
    if is_share or isinstance(given, Mapping | Curve) or given in NAMES:
        return given
    raise ValueError(
        f"{bounded.quoted(given)!r} is no reflectance; give a number from 0 to 1, a CSV file with "
        f"wavelength_nm,reflectance, or one of {', '.join(NAMES)}"
    )


Reflectance = Annotated[Share | Curve | str, BeforeValidator(_read)]
"""A number, the same at every wavelength; the name of a surface of forests; or a curve."""


def material_of(given: "float | Curve | str") -> Material:
    """Return the surface of a reflectance; a curve says nothing beyond its ends."""
    if isinstance(given, Curve):
        ends = given.wavelengths_nm[0], given.wavelengths_nm[-1]
        return Material(given.spectrum(), known_nm=ends)
    return Material(reflectance_of(given) if isinstance(given, str) else flat(given))
