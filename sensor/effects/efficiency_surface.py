"""Photon detection probability over wavelength and excess bias, PDP(λ, V).

The surface is tabulated and bilinear between points. At a bias V it is thus the sum of its curves,
each times the share of its bias in V.
"""

from itertools import pairwise
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.core.record import Record


class EfficiencySurface(Record, frozen=True):
    """Photon detection probability over wavelength and excess bias."""

    wavelengths_nm: Annotated[tuple[Annotated[float, Field(gt=0)], ...], Field(min_length=2)]
    """Wavelengths of the points, increasing (nm)."""
    excess_v: Annotated[tuple[Annotated[float, Field(ge=0)], ...], Field(min_length=2)]
    """Excess biases of the points, increasing (V)."""
    values: tuple[tuple[Annotated[float, Field(ge=0, le=1)], ...], ...]
    """PDP at each point, a row for each bias."""

    @model_validator(mode="after")
    def _check_grid(self) -> Self:
        sizes = len(self.excess_v), len(self.wavelengths_nm)
        if len(self.values) != sizes[0] or any(len(row) != sizes[1] for row in self.values):
            raise ValueError(
                f"efficiency_surface.values: give {sizes[0]} rows, one for each bias excess_v, of "
                f"{sizes[1]} values, one for each of wavelengths_nm"
            )
        for name in ("excess_v", "wavelengths_nm"):
            if any(after <= before for before, after in pairwise(getattr(self, name))):
                raise ValueError(f"efficiency_surface.{name}: must increase; sort the points")
        return self

    def curve_at(self, excess_v: float) -> dict[str, Any]:
        """Return the fields of the curve at a bias (V); ValueError if that is outside."""
        self.check(excess_v)
        values = self.shares(excess_v) @ np.array(self.values)
        return {"wavelengths_nm": self.wavelengths_nm, "values": tuple(values.tolist())}

    def shares(self, excess_v: ArrayLike) -> Floats:
        """Return the shares of the curves at biases (…), (curves, …)."""
        curves = np.eye(len(self.values))
        return np.array([np.interp(np.asarray(excess_v), self.excess_v, one) for one in curves])

    def in_flat_light(self, excess_v: ArrayLike) -> Floats:
        """Mean PDP over the photons of a flat spectrum over all its wavelengths, at biases (…)."""
        nm, values = np.array(self.wavelengths_nm), np.array(self.values)
        # Simpson's rule is exact for the parabolas λ·PDP(λ)
        middle = (nm[1:] + nm[:-1]) * (values[:, 1:] + values[:, :-1])
        parts = np.diff(nm) * (nm[:-1] * values[:, :-1] + middle + nm[1:] * values[:, 1:]) / 6
        means = 2 * parts.sum(1) / (nm[-1] ** 2 - nm[0] ** 2)
        return np.asarray(np.interp(np.asarray(excess_v), self.excess_v, means))

    def check(self, excess_v: ArrayLike) -> None:
        """Raise ValueError if a bias (V) is outside the surface."""
        lowest, highest = float(np.min(excess_v)), float(np.max(excess_v))
        if lowest < self.excess_v[0] or highest > self.excess_v[-1]:
            raise ValueError(
                f"bias.efficiency_surface: covers {self.excess_v[0]:g} to {self.excess_v[-1]:g} V, "
                f"pixels need {lowest:.4g} to {highest:.4g} V; extend the file, or change "
                "bias.excess_v or bias.breakdown_sigma_v"
            )
