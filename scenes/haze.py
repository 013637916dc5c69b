"""Droplets in the air, which scatter light between the objects and the camera.

How far one sees is told by the visibility V: at this distance a black object stands out by 2 % of
the light around it (Koschmieder 1924, Beiträge zur Physik der freien Atmosphäre 12, 33), so that
the extinction is σ = ln 50 / V. Directions follow Henyey and Greenstein (1941, Astrophysical
Journal 93, 70), p = (1 − g²) / (4π·(1 + g² − 2g·cos θ)^(3/2)) with the angle θ of the turn.

Nothing depends on the wavelength: droplets of fog and mist are large against it (radii of 1 to
20 µm), where extinction is twice the cross section, and absorb little of the light that they meet:
less than 1e-5 in the visible, about 2 % at 1.45 µm (`scenes/spectra/outdoors.py` has the law). Dry
haze of particles below 0.5 µm, which is bluish, is not this.
"""

import math
from typing import Annotated

from pydantic import Field

from megalopta.core.record import Record

CONTRAST = 0.02
"""Of a black object at the visibility, against what is behind it."""


class Haze(Record, frozen=True):
    """Mist or fog, the same everywhere from below the lowest to above the highest object."""

    visibility_m: Annotated[float, Field(ge=1, le=1e6)]
    """Distance at which a black object stands out by 2 % of the light around it; mist has more than
    1000, fog less (m)."""

    albedo: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Share of the light met that droplets scatter; the rest they absorb (1)."""

    asymmetry: Annotated[float, Field(gt=-1, lt=1)] = 0.85
    """Mean cosine of the angle by which scattered light turns; 0 is evenly to all sides, and cloud
    droplets have 0.85 (1)."""

    @property
    def extinction_per_m(self) -> float:
        """Share of a beam's light that is scattered or absorbed, per way."""
        return math.log(1 / CONTRAST) / self.visibility_m
