"""Photon detection probability (PDP): fraction of the photons on the active area that are detected.

The photon detection efficiency (PDE), of the photons on the whole pixel, is PDP times fill factor.
The curve is tabulated and linear between points. A band's PDP is the mean over its photons, for a
spectrum that is flat inside the band,

    PDP_b = ∫ PDP(λ)·λ dλ / ∫ λ dλ

Between points the integrand is a parabola, or a cubic with the transmission T(λ) of the lens.
Simpson's rule is exact for both: no point is lost however narrow or wide the band. With a color
filter, too, Gauss and Legendre's rule of three points is exact. The curve holds at one operating
point; `bias` scales it elsewhere.

A measured curve of efficiency, or of the lens's transmission, comes from a CSV file
(`core.curve_file`). It is read once, and its numbers replace its path in the sensor's description.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.bounded import file_content, named_path
from megalopta.core.curve_file import curve_of
from megalopta.sensor.effects.base import Effect, Stage
from megalopta.sensor.optics.lens import Lens, WavelengthCurve, check_bands


class Efficiency(WavelengthCurve, Effect, frozen=True):
    """Photon detection probability over wavelength; a constant is a curve of two points."""

    field: ClassVar[str] = "efficiency"
    stage: ClassVar[Stage] = Stage.LIGHT
    statement: ClassVar[str] = (
        "a fraction of the photons on the active area, by wavelength, starts an avalanche"
    )

    values: tuple[Annotated[float, Field(ge=0, le=1)], ...]
    """Detected fraction of the photons on the active area (PDP = PDE over fill factor)."""

    @property
    def is_on(self) -> bool:
        """True if a photon may be missed."""
        return min(self.values) < 1

    @classmethod
    def off(cls) -> "Efficiency":
        """Return an efficiency of 1."""
        return cls(wavelengths_nm=(1.0, 1e6), values=(1.0, 1.0))


def band_efficiency(
    efficiency: Efficiency,
    bands_nm: ArrayLike,
    lens: Lens | None = None,
    filters: Sequence[WavelengthCurve] = (),
) -> Floats:
    """Return the mean PDP over the photons of each band, (B,), from 0 to 1.

    With a lens or filters, PDP is multiplied by their curves. Bands (B, 2) are lower and upper
    edges, nm.
    Raises ValueError if a band reaches outside a curve.
    """
    passing = lens.transmission_curve if lens else None
    return _photon_means([efficiency, *([passing] if passing else []), *filters], bands_nm)


def band_transmission(lens: Lens, bands_nm: ArrayLike) -> Floats:
    """Return the mean of the lens's curve over the photons of each band; as `band_efficiency`."""
    return _photon_means([lens.transmission_curve] if lens.transmission_curve else [], bands_nm)


def _photon_means(curves: Sequence[WavelengthCurve], bands_nm: ArrayLike) -> Floats:
    bands = check_bands(bands_nm)
    for (lower, upper), curve in product(bands, curves):
        first, last = curve.wavelengths_nm[0], curve.wavelengths_nm[-1]
        if lower < first or upper > last:
            raise ValueError(
                f"bands_nm: {lower:g}–{upper:g} nm reaches outside the "
                f"{curve.field.removesuffix('_curve')} curve, {first:g}–{last:g} nm; extend the "
                "curve or drop the band"
            )
    return np.array([_photon_mean(curves, lower, upper) for lower, upper in bands])


def _photon_mean(curves: Sequence[WavelengthCurve], lower: float, upper: float) -> float:
    points = np.unique([point for curve in curves for point in curve.wavelengths_nm])
    nodes = np.concatenate(([lower], points[(points > lower) & (points < upper)], [upper]))
    middle = (nodes[:-1] + nodes[1:]) / 2

    def seen(at: Floats) -> Floats:
        passing = [np.interp(at, curve.wavelengths_nm, curve.values) for curve in curves]
        return np.asarray(np.prod([at, *passing], 0))

    if len(curves) < 3:
        at_nodes = seen(nodes)
        integrals = np.diff(nodes) * (at_nodes[:-1] + 4 * seen(middle) + at_nodes[1:]) / 6
    else:
        places, weights = np.polynomial.legendre.leggauss(3)
        half = np.diff(nodes) / 2
        integrals = half * sum(
            weight * seen(middle + place * half)
            for place, weight in zip(places, weights, strict=True)
        )
    return float(integrals.sum() / ((upper**2 - lower**2) / 2))


def with_curve(curve: Any, folder: Path | None, field: str = "efficiency") -> Any:
    """Return the curve in the file for `{path: FILE}`, and anything else unchanged.

    Raises ValueError if a path and numbers are both given, or the file holds no curve.
    """
    if not isinstance(curve, Mapping) or not isinstance(curve.get("path"), str):
        return curve
    if len(curve) > 1:
        others = ", ".join(str(name) for name in curve if name != "path")
        raise ValueError(f"{field}: path and {others} given; give a file or numbers, not both")
    path = named_path(curve["path"], folder)
    return curve_of(file_content(path, field), f"{field}: {path}", "efficiency")


def with_curves(part: str) -> Callable[[Any, Path | None], Any]:
    """Return a function that gives a part of a sensor, such as its lens, the curves of its files.

    As `with_curve`.
    """

    def resolved(values: Any, folder: Path | None) -> Any:
        if not isinstance(values, Mapping):
            return values
        return {name: with_curve(value, folder, f"{part}.{name}") for name, value in values.items()}

    return resolved
