"""How pixels of one device differ in dead time, afterpulsing and crosstalk."""

from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor.effects.base import PixelRates
from megalopta.sensor.sampling.streams import pixel_normals


class AvalancheMaps(NamedTuple):
    """Factors on the values of a sensor's fields, (rows, columns) each."""

    dead_time: Floats
    """On `dead_time.dead_time_s`"""
    afterpulsing: Floats
    """On `afterpulsing.mean_carriers`"""
    crosstalk: Floats
    """On `crosstalk.mean_fired_neighbors` of avalanches in this pixel"""

    @classmethod
    def alike(cls, shape: tuple[int, int]) -> "AvalancheMaps":
        """Pixels that do not differ."""
        return cls(*(np.ones(shape) for _ in cls._fields))

    @classmethod
    def of(cls, rates: PixelRates) -> "AvalancheMaps | None":
        """What the effects on rates have found; none where pixels are as the fields say."""
        factors = [rates.factors.get(name, np.ones(rates.shape)) for name in cls._fields]
        return cls(*factors) if any(np.any(factor != 1) for factor in factors) else None


def draw_mismatch(rates: PixelRates, name: str, sigma: float) -> None:
    """Multiply the factor of this name by log-normal numbers of mean 1, unless it was measured."""
    if sigma > 0 and name not in rates.measured:
        log_sigma = np.sqrt(np.log1p(sigma**2))
        normals = pixel_normals(rates.shape, rates.device_seed, f"{name} mismatch")
        rates.scale(name, np.exp(log_sigma * normals - log_sigma**2 / 2))
