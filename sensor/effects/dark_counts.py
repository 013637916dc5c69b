"""Dark counts: avalanches without a photon, Poisson, at each pixel's own rate.

The rate per active area is drawn once per device: for most pixels from a normal distribution
truncated at zero, for the fraction of "hot" pixels from a log-normal one (positive, long tail). The
pattern depends on the device seed and the pixel's row and column, so it is the same in every frame
and for any image size.

Source: dissertation §2.4.4 and §2.4.7, where the bulk is normal and hot pixels are outliers. The
log-normal is an assumption: five hot pixels were measured. The rate holds at one bias and one
temperature.
"""

from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.special import ndtr, ndtri

from megalopta.core.arrays import Floats
from megalopta.sensor.effects.base import Effect, PixelRates, Stage
from megalopta.sensor.sampling.streams import pixel_uniforms

_UM2_PER_M2 = 1e12


class DarkCounts(Effect, frozen=True):
    """Distribution of the dark count rate over the pixels; all zero: no dark counts."""

    stage: ClassVar[Stage] = Stage.DEVICE
    statement: ClassVar[str] = (
        "dark carriers arrive in addition to photons, at a rate of each pixel's own"
    )

    bulk_mean_hz_um2: Annotated[float, Field(ge=0)] = 0.0
    """Mean of the normal distribution of ordinary pixels before truncation at zero (Hz/µm²)."""
    bulk_sigma_hz_um2: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of that normal distribution (Hz/µm²)."""
    hot_fraction: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Fraction of pixels that are hot (0 to 1)."""
    hot_mean_hz_um2: Annotated[float, Field(ge=0)] = 0.0
    """Mean rate of hot pixels (Hz/µm²)."""
    hot_sigma_hz_um2: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the rate of hot pixels (Hz/µm²)."""

    @model_validator(mode="after")
    def _check_hot(self) -> Self:
        if self.hot_mean_hz_um2 == 0 and (self.hot_fraction > 0 or self.hot_sigma_hz_um2 > 0):
            raise ValueError(
                f"dark_counts.hot_mean_hz_um2: 0 with hot_fraction {self.hot_fraction:g} and "
                f"hot_sigma_hz_um2 {self.hot_sigma_hz_um2:g}; give hot pixels a rate or none"
            )
        return self

    @property
    def is_on(self) -> bool:
        """True if there are any."""
        bulk = self.hot_fraction < 1 and max(self.bulk_mean_hz_um2, self.bulk_sigma_hz_um2) > 0
        return bulk or self.hot_fraction * self.hot_mean_hz_um2 > 0

    def act_on_rates(self, rates: PixelRates) -> None:
        """Set the dark count rate of every pixel."""
        density = dark_count_density(self, rates.shape, rates.device_seed)
        rates.dark_counts_hz = density * (rates.active_area_m2 * _UM2_PER_M2)


def dark_count_density(dark_counts: DarkCounts, shape: tuple[int, int], device_seed: int) -> Floats:
    """Dark count rate per active area of every pixel of a device, (rows, columns) Hz/µm²."""
    is_hot = pixel_uniforms(shape, device_seed, "dark counts, hot") < dark_counts.hot_fraction
    rank = 1 - pixel_uniforms(shape, device_seed, "dark counts, rate")
    return np.where(is_hot, _hot_density(dark_counts, rank), _bulk_density(dark_counts, rank))


def _bulk_density(dark_counts: DarkCounts, rank: Floats) -> Floats:
    # rank in (0, 1] is the upper tail probability, which keeps the quantile finite
    mean, sigma = dark_counts.bulk_mean_hz_um2, dark_counts.bulk_sigma_hz_um2
    if sigma == 0:
        return np.full_like(rank, mean)
    return np.maximum(mean - sigma * ndtri(rank * ndtr(mean / sigma)), 0.0)


def _hot_density(dark_counts: DarkCounts, rank: Floats) -> Floats:
    mean, sigma = dark_counts.hot_mean_hz_um2, dark_counts.hot_sigma_hz_um2
    if sigma == 0:
        return np.full_like(rank, mean)
    log_variance = np.log1p((sigma / mean) ** 2)
    return np.asarray(mean * np.exp(-np.sqrt(log_variance) * ndtri(rank) - log_variance / 2))
