"""How much of the light passes a lens or a filter, by wavelength; straight between the points."""

from itertools import pairwise
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, model_validator


class Transmission(
    BaseModel, frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
):
    """A curve of transmission over wavelength."""

    wavelengths_nm: Annotated[tuple[Annotated[float, Field(gt=0)], ...], Field(min_length=2)]
    """Points of the curve, increasing (nm)."""
    values: tuple[Annotated[float, Field(ge=0, le=1)], ...]
    """Fraction of the light that passes at each point."""

    @model_validator(mode="after")
    def _check_curve(self) -> Self:
        if len(self.wavelengths_nm) != len(self.values):
            raise ValueError(
                f"lens.transmission_curve: {len(self.wavelengths_nm)} wavelengths_nm for "
                f"{len(self.values)} values; give one value per wavelength"
            )
        for before, after in pairwise(self.wavelengths_nm):
            if after <= before:
                raise ValueError(
                    f"lens.transmission_curve.wavelengths_nm: {after:g} follows {before:g}; sort "
                    "the curve"
                )
        return self

    def __call__(self, wavelength_nm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Fraction that passes at each wavelength (nm) inside the curve."""
        return np.interp(wavelength_nm, self.wavelengths_nm, self.values)
