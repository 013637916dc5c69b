"""How much of the light passes a lens or a filter, by wavelength; straight between the points."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, model_validator


def check_curve(field: str, wavelengths_nm: Sequence[float], values: Sequence[float]) -> None:
    """Make sure that a curve has one value for each wavelength, and these in order.

    Raises
    ------
    ValueError
        With one sentence that begins with the field.
    """
    if len(wavelengths_nm) != len(values):
        raise ValueError(
            f"{field}: {len(wavelengths_nm)} wavelengths_nm for {len(values)} values; give one "
            "value per wavelength"
        )
    for before, after in pairwise(wavelengths_nm):
        if after <= before:
            raise ValueError(
                f"{field}.wavelengths_nm: {after:g} follows {before:g}; sort the curve"
            )


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
        check_curve("lens.transmission_curve", self.wavelengths_nm, self.values)
        return self

    def __call__(self, wavelength_nm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Fraction that passes at each wavelength (nm) inside the curve."""
        return np.interp(wavelength_nm, self.wavelengths_nm, self.values)
