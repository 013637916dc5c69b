"""Droplets in the air that scatter light between objects and camera.

The visibility V is the distance at which a black object has a contrast of 2 % (Koschmieder 1924,
Beiträge zur Physik der freien Atmosphäre 12, 33), so the extinction is σ = ln 50 / V. Directions
follow Henyey and Greenstein (1941, Astrophysical Journal 93, 70), p = (1 − g²) / (4π·(1 + g² −
2g·cos θ)^(3/2)) with the scattering angle θ.

Haze is independent of wavelength: droplets of fog and mist are large compared with it (radii of 1
to 20 µm), so extinction is twice the cross section. They absorb little light: less than 1e-5 in the
visible, about 2 % at 1.45 µm (formula in `scenes/spectra/outdoors.py`). Dry, bluish haze of
particles below 0.5 µm is not modeled.
"""

import math
from typing import Annotated

from pydantic import Field

from megalopta.core.record import Record

CONTRAST = 0.02
"""Contrast of a black object at the visibility against its background."""


class Haze(Record, frozen=True):
    """Uniform mist or fog, from below the lowest to above the highest object."""

    visibility_m: Annotated[float, Field(ge=1, le=1e6)]
    """Distance at which a black object has a contrast of 2 %; mist has more than 1000, fog less
    (m)."""

    albedo: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Scattered share of the extinction; droplets absorb the rest (1)."""

    asymmetry: Annotated[float, Field(gt=-1, lt=1)] = 0.85
    """Mean cosine of the scattering angle; 0: isotropic; cloud droplets have 0.85 (1)."""

    @property
    def extinction_per_m(self) -> float:
        """Share of a beam's light that is scattered or absorbed, per meter."""
        return math.log(1 / CONTRAST) / self.visibility_m
