"""Piecewise linear functions of wavelength, and photometry.

V(λ) is the CIE 1924 photopic curve at steps of 10 nm, linear between; its integral is 106.86 nm, so
a flat spectrum of luminance L_v has L_λ = L_v / (683 · 106.86).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.constants import c, h, k

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.bounded import quoted

TABLES: Mapping[str, tuple[float, ...]] = {
    name: tuple(map(float, values))
    for name, values in strict_yaml.load(
        Path(__file__).with_name("tables.yaml").read_text("utf-8")
    ).items()
}
"""Numbers of this package's spectra by name; the file states their units."""


@dataclass(frozen=True)
class Spectrum:
    """Values at wavelengths, linear between them and constant beyond the first and last.

    `check_known` refuses bands beyond: there the values say nothing.
    """

    wavelengths_nm: tuple[float, ...]
    """Strictly increasing wavelengths, nm."""
    values: tuple[float, ...]
    """Values, of the same length; the owner sets the unit (reflectance: 1)."""
    known_nm: tuple[float, float] | None = None
    """Range in which values are known, nm; None: from first to last; of one value, everywhere."""

    def __post_init__(self) -> None:
        """Reject tables that are not functions."""
        if len(self.wavelengths_nm) != len(self.values) or not self.values:
            raise ValueError(
                f"spectrum: {len(self.wavelengths_nm)} wavelengths for {len(self.values)} values; "
                "give one value per wavelength"
            )
        ends = self.wavelengths_nm[0], self.wavelengths_nm[-1]
        if not (np.all(np.diff(self.wavelengths_nm) > 0) and np.isfinite(ends).all()):
            raise ValueError(
                f"spectrum: wavelengths {quoted(self.wavelengths_nm)} must increase and be finite"
            )
        if not np.all(np.isfinite(self.values)) or min(self.values) < 0:
            raise ValueError(
                f"spectrum: values {quoted(self.values)} must be finite and non-negative"
            )

    @classmethod
    def of(
        cls,
        wavelengths_nm: ArrayLike,
        values: ArrayLike,
        known_nm: tuple[float, float] | None = None,
    ) -> "Spectrum":
        """Return the spectrum of values (n,) at wavelengths (n,)."""
        tables = (np.asarray(column, np.float64).tolist() for column in (wavelengths_nm, values))
        at_nm, values_there = map(tuple, tables)
        return cls(at_nm, values_there, known_nm)

    def __call__(self, wavelength_nm: ArrayLike) -> Floats:
        """Value at each wavelength (nm)."""
        return np.interp(np.asarray(wavelength_nm, np.float64), self.wavelengths_nm, self.values)

    def scaled(self, factor: float) -> "Spectrum":
        """Return the same shape times a non-negative factor."""
        values = tuple(float(factor * value) for value in self.values)
        return Spectrum(self.wavelengths_nm, values, self.known_nm)

    @property
    def range_nm(self) -> tuple[float, float]:
        """Lowest and highest wavelength at which the values are known."""
        if self.known_nm is None and len(self.values) == 1:
            return -math.inf, math.inf
        return self.known_nm or (self.wavelengths_nm[0], self.wavelengths_nm[-1])


def common_range(spectra: Sequence[Spectrum]) -> tuple[float, float]:
    """Return the wavelengths (nm) between which all spectra are known."""
    lowest, highest = zip(*(spectrum.range_nm for spectrum in spectra), strict=True)
    return max(lowest), min(highest)


def check_known(
    name: str, range_nm: tuple[float, float], bands_nm: Sequence[tuple[float, float]], remedy: str
) -> None:
    """Raise ValueError for a band outside the range in which the spectrum of a thing is known."""
    low, high = range_nm
    for first, last in bands_nm:
        if first < low or last > high:
            raise ValueError(
                f"{name}: its spectrum is known from {low:g} to {high:g} nm, and bands_nm has "
                f"{first:g} to {last:g}; {remedy}omit the band"
            )


def flat(value: float) -> Spectrum:
    """Return the spectrum that is `value` at every wavelength."""
    return Spectrum((550.0,), (value,))


def total(spectra: Sequence[Spectrum]) -> Spectrum:
    """Return the sum of spectra, exact at all wavelengths; 0 without any."""
    wavelengths = sorted({nm for spectrum in spectra for nm in spectrum.wavelengths_nm})
    values = sum((spectrum(wavelengths) for spectrum in spectra), np.zeros(len(wavelengths)))
    return Spectrum.of(wavelengths, values, common_range(spectra)) if spectra else flat(0.0)


def planckian(temperature_k: float) -> Spectrum:
    """Relative spectrum of a black body at 300 to 2000 nm, with largest value 1 (Planck's law)."""
    wavelengths_nm = np.concatenate([np.arange(300, 800, 10), np.arange(800, 2001, 50)])
    meters = wavelengths_nm * 1e-9
    values = meters**-5 / np.expm1(h * c / (meters * k * temperature_k))
    return Spectrum.of(wavelengths_nm, values / values.max())


SpectrumName = Literal["D65", "equal_energy"]
SPECTRA: Mapping[SpectrumName, Spectrum] = {
    "D65": Spectrum.of(np.arange(300, 831, 10), TABLES["D65"]),
    "equal_energy": flat(1.0),
}
"""Relative spectra by name (CIE 15:2004)."""

MAXIMUM_EFFICACY_LM_W = 683.0

_V_FIRST_NM = 380.0
_V_STEP_NM = 10.0
_V = TABLES["luminous efficiency"]
PHOTOPIC_NM = np.arange(_V_FIRST_NM, _V_FIRST_NM + _V_STEP_NM * len(_V))
"""Wavelengths at which photometric integrals are summed, nm"""


def luminous_efficiency(wavelength_nm: Floats) -> Floats:
    """CIE 1924 photopic luminous efficiency V(λ), 0 outside 380 to 770 nm; of any shape."""
    table_nm = _V_FIRST_NM + _V_STEP_NM * np.arange(len(_V))
    return np.interp(wavelength_nm, table_nm, _V, left=0.0, right=0.0)


def luminous(spectrum: Spectrum) -> float:
    """Photometric value of a spectral quantity: 683 lm/W · ∫ S(λ)·V(λ) dλ.

    Irradiance in W·m⁻²·nm⁻¹ gives lux, radiance in W·m⁻²·sr⁻¹·nm⁻¹ gives cd/m². The trapezoidal
    rule in steps of 1 nm is exact to 1e-4 for spectra without narrow lines.
    """
    seen = spectrum(PHOTOPIC_NM) * luminous_efficiency(PHOTOPIC_NM)
    return float(MAXIMUM_EFFICACY_LM_W * np.trapezoid(seen, PHOTOPIC_NM))
