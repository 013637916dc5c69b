"""How many of the photons on the active area are detected: photon detection efficiency (PDE).

A tabulated curve with straight lines between its points. A band's efficiency is the mean over its
photons, for a spectrum that is flat inside the band,

    PDE_b = ∫ PDE(λ)·λ dλ / ∫ λ dλ

The integrand is a parabola between the points of the curve, for which Simpson's rule is exact, so
no point is lost however narrow or wide the band. The curve holds at one operating point; `bias`
scales it elsewhere, alike at all wavelengths.
"""

from itertools import pairwise
from typing import Annotated, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from megalopta.sensor.effects import Effect, Stage
from megalopta.sensor.optics.lens import check_bands


class Efficiency(Effect, frozen=True):
    """Photon detection efficiency over wavelength; a constant one is a curve of two points."""

    stage: ClassVar[Stage] = Stage.LIGHT
    statement: ClassVar[str] = (
        "a fraction of the photons on the active area, by wavelength, starts an avalanche"
    )

    wavelengths_nm: Annotated[tuple[Annotated[float, Field(gt=0)], ...], Field(min_length=2)]
    """Points of the curve, increasing (nm)."""
    values: tuple[Annotated[float, Field(ge=0, le=1)], ...]
    """Detected fraction of the photons on the active area at each point; no fill factor in it."""

    @model_validator(mode="after")
    def _check_curve(self) -> Self:
        if len(self.wavelengths_nm) != len(self.values):
            raise ValueError(
                f"efficiency: {len(self.wavelengths_nm)} wavelengths_nm for {len(self.values)} "
                "values; give one value per wavelength"
            )
        for before, after in pairwise(self.wavelengths_nm):
            if after <= before:
                raise ValueError(
                    f"efficiency.wavelengths_nm: {after:g} follows {before:g}; sort the curve"
                )
        return self

    @property
    def is_on(self) -> bool:
        """Whether a photon may be missed."""
        return min(self.values) < 1

    @classmethod
    def off(cls) -> "Efficiency":
        """Return an efficiency of 1."""
        return cls(wavelengths_nm=(1.0, 1e6), values=(1.0, 1.0))

    def __call__(self, wavelength_nm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Efficiency at each wavelength (nm) inside the curve."""
        return np.interp(wavelength_nm, self.wavelengths_nm, self.values)


def band_efficiency(efficiency: Efficiency, bands_nm: ArrayLike) -> NDArray[np.float64]:
    """Mean efficiency over the photons of each band.

    Parameters
    ----------
    efficiency : Efficiency
    bands_nm : (B, 2)
        Lower and upper edge of each band, nm.

    Returns
    -------
    (B,) float64
        Between 0 and 1.

    Raises
    ------
    ValueError
        When a band reaches outside the curve.
    """
    bands = check_bands(bands_nm)
    first, last = efficiency.wavelengths_nm[0], efficiency.wavelengths_nm[-1]
    for lower, upper in bands:
        if lower < first or upper > last:
            raise ValueError(
                f"bands_nm: {lower:g}–{upper:g} nm reaches outside the efficiency curve, "
                f"{first:g}–{last:g} nm; extend the curve or drop the band"
            )
    return np.array([_photon_mean(efficiency, lower, upper) for lower, upper in bands])


def _photon_mean(efficiency: Efficiency, lower: float, upper: float) -> float:
    points = np.array(efficiency.wavelengths_nm)
    nodes = np.concatenate(([lower], points[(points > lower) & (points < upper)], [upper]))
    middle = (nodes[:-1] + nodes[1:]) / 2
    at_nodes, at_middle = efficiency(nodes) * nodes, efficiency(middle) * middle
    integrals = np.diff(nodes) * (at_nodes[:-1] + 4 * at_middle + at_nodes[1:]) / 6
    return float(integrals.sum() / ((upper**2 - lower**2) / 2))
