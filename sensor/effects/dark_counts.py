"""Dark counts: avalanches without a photon, Poisson, at each pixel's own rate.

The rate per active area is drawn once per device: for most pixels from a normal distribution
truncated at zero, for the fraction of "hot" pixels from a log-normal one (positive, long tail). The
pattern depends on the device seed and the pixel's row and column, so it is the same in every frame
and for any image size.

Source: dissertation §2.4.4 and §2.4.7, where the bulk is normal and hot pixels are outliers. The
log-normal is an assumption: five hot pixels were measured. The rate holds at one bias and one
temperature.

**Random telegraph noise**: dark counts of some pixels switch between levels at random times.

A trap adds `step` times the pixel's own rate while it is active, a share of the time. Its state is
redrawn after exponential waiting times of mean τ, so that its spectrum is a Lorentzian. τ is drawn
for each trap between `fastest_s` and `slowest_s`, uniformly in its logarithm.

The device determines which pixels have traps and how fast these are. The state of a trap is a
function of run and time, whichever frames are drawn. The state at the start of an exposure holds
for all of it: traps that switch within one are too fast for this model.

Source: Machlup, J. Appl. Phys. 25, 341 (1954) for the spectrum; McWhorter, in Semiconductor Surface
Physics (1957), for the mixture; Karami et al., Opt. Eng. 53, 2014, for levels of dark counts in
SPADs that switch over seconds to hours.
"""

from typing import Annotated, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.special import ndtr, ndtri

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled
from megalopta.sensor.effects.base import Effect
from megalopta.sensor.sampling.streams import mixed, pixel_uniforms, uniform


class DarkCounts(Effect, frozen=True):
    """Distribution of the dark count rate over the pixels; all zero: no dark counts."""

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


def dark_count_density(dark_counts: DarkCounts, shape: tuple[int, int], device_seed: int) -> Floats:
    """Dark count rate per active area of every pixel of a device, (rows, columns) Hz/µm²."""
    is_hot = pixel_uniforms(shape, device_seed, "dark counts, hot") < dark_counts.hot_fraction
    rank = 1 - pixel_uniforms(shape, device_seed, "dark counts, rate")
    # rank in (0, 1] is the upper tail probability, which keeps the quantile finite
    mean, sigma = dark_counts.bulk_mean_hz_um2, dark_counts.bulk_sigma_hz_um2
    bulk = np.full_like(rank, mean)
    if sigma > 0:
        bulk = np.maximum(mean - sigma * ndtri(rank * ndtr(mean / sigma)), 0.0)
    mean, sigma = dark_counts.hot_mean_hz_um2, dark_counts.hot_sigma_hz_um2
    hot = np.full_like(rank, mean)
    if sigma > 0:
        log_variance = np.log1p((sigma / mean) ** 2)
        hot = mean * np.exp(-np.sqrt(log_variance) * ndtri(rank) - log_variance / 2)
    return np.where(is_hot, hot, bulk)


_NONE_IN_A_BLOCK = np.exp(-1.0)
"""Probability that a Poisson number of mean 1 is 0."""


class Telegraph(Effect, frozen=True):
    """Dark counts that switch between levels; off by default."""

    switch: ClassVar[str] = "share"

    share: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Fraction of pixels that switch (0: none)."""
    traps: Annotated[int, Field(ge=1, le=16)] = 1
    """Traps of each of these pixels: one makes two levels, n make n + 1."""
    step: Annotated[float, Field(gt=0, le=100)] = 1.0
    """Dark count rate that an active trap adds, relative to the pixel's own."""
    active_share: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Fraction of time that a trap is active."""
    fastest_s: Annotated[float, Field(gt=0)] = 1.0
    """Correlation time of the fastest traps (s)."""
    slowest_s: Annotated[float, Field(gt=0)] = 1.0
    """Correlation time of the slowest traps (s)."""

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        if self.slowest_s < self.fastest_s:
            raise ValueError(
                f"telegraph.slowest_s: {self.slowest_s:g} is less than fastest_s "
                f"{self.fastest_s:g}; give the longer correlation time"
            )
        return self


class Traps(NamedTuple):
    """Pixels of a device whose dark counts switch."""

    step: Floats
    """Factor on `telegraph.step` of every pixel, (H, W); 0: it does not switch"""
    pixels: Ints
    """Row and column of each switching pixel, (N, 2)"""
    times_s: Floats
    """Correlation times of the K traps of each, (N, K)"""


def draw_traps(
    telegraph: Telegraph, shape: tuple[int, int], device_seed: int, measured_step: Floats | None
) -> Traps:
    """Return the traps of a device: of the pixels with a measured step, or of drawn ones."""
    if measured_step is None:
        switches = pixel_uniforms(shape, device_seed, "telegraph, share") < telegraph.share
        step = switches.astype(np.float64)
    else:
        switches, step = measured_step > 0, measured_step
    ranks = [
        pixel_uniforms(shape, device_seed, "telegraph, time", trap)[switches]
        for trap in range(telegraph.traps)
    ]
    spread = telegraph.slowest_s / telegraph.fastest_s
    times_s = telegraph.fastest_s * spread ** np.stack(ranks, axis=-1)
    return Traps(step, np.argwhere(switches), times_s)


def telegraph_factor(telegraph: Telegraph, traps: Traps, run: int, time_s: float) -> Floats:
    """Return the factor on dark counts (H, W) at a time of a run, for the traps active then."""
    active = np.zeros(traps.step.shape)
    pixels, times_s = traps.pixels, traps.times_s
    _add_active(np.uint64(run), time_s, telegraph.active_share, pixels, times_s, active)
    return 1 + telegraph.step * traps.step * active


def telegraph_levels(telegraph: Telegraph, traps: Traps) -> list[tuple[float, Floats]]:
    """Return the probability of each number of active traps, and its factor on dark counts."""
    from scipy.stats import binom  # slow to load

    numbers = np.arange(telegraph.traps + 1)
    chances = binom.pmf(numbers, telegraph.traps, telegraph.active_share)
    factors = (np.asarray(1 + telegraph.step * active * traps.step) for active in numbers)
    return list(zip(map(float, chances), factors, strict=True))


@compiled
def _add_active(
    run: np.uint64,
    time_s: float,
    active_share: float,
    pixels: Ints,
    times_s: Floats,
    active: Floats,
) -> None:
    """Add traps as last redrawn, by a Poisson process in blocks of their correlation time."""
    for at in range(pixels.shape[0]):
        row, column = pixels[at]
        pixel = mixed(mixed(run ^ np.uint64(row)) ^ np.uint64(column))
        for trap in range(times_s.shape[1]):
            now = time_s / times_s[at, trap]
            block = np.int64(np.floor(now))
            latest, is_active = -1.0, False
            while latest < 0:
                word = mixed(mixed(pixel ^ np.uint64(trap)) ^ np.uint64(block))
                chance = 1.0
                while True:
                    word = mixed(word)
                    chance *= uniform(word)
                    if chance < _NONE_IN_A_BLOCK:
                        break
                    word = mixed(word)
                    moment = uniform(word)
                    word = mixed(word)
                    if latest < moment <= now - block:
                        latest, is_active = moment, uniform(word) < active_share
                block -= 1
            active[row, column] += is_active
