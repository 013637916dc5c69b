"""Excess bias, its mismatch, and temperature: what moves together with them.

At V = excess_v − δ − Δ, with δ of the pixel and Δ of the temperature, relative to reference_v,

    efficiency    f(V)/f(reference),   f(V) = 1 − exp(−(V − onset_v)/efficiency_scale_v)
    dark counts   exp((V − reference)/dark_efold_v)
    afterpulsing, crosstalk   1 + slope·(V − reference)/reference, and not below 0

and the first two are 0 below the onset. The charge of an avalanche is the pixel's capacitance times
V, and traps and light are proportional to it: slope 1. A slope above 1 includes that a carrier is
more likely to fire at higher V.

The first is the usual saturating avalanche probability; the second is empirical. Their ratio is
largest at V* = onset + efficiency_scale·ln(1 + dark_efold/efficiency_scale). δ is normal.

A measured map already contains each pixel's mismatch. It is multiplied by the factor from the
reference bias to this one at the pixel's own δ, which is 1 at the reference bias.

Source: dissertation §2.4.4 to §2.4.7. `efficiency_scale_v` or `dark_efold_v` of None disables that
dependence.

**Temperature**: thermal dark counts double every few kelvin; the breakdown voltage rises.

    DCR(T) = DCR(T_ref)·2^((T − T_ref)/ΔT)

The breakdown voltage rises linearly, by 0.02 to 0.06 V/K in silicon diodes that break down at 15 to
40 V. So the excess bias falls at a constant bias (`bias`). Source of ΔT: dissertation §2.3.1 and
`docs/theory/device.md`.
"""

from collections.abc import Callable
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.sensor.effects.base import Effect
from megalopta.sensor.sampling.streams import pixel_normals


class Bias(Effect, frozen=True):
    """Excess bias, its mismatch and the quantities that depend on it; by default none do."""

    excess_v: Annotated[float, Field(gt=0)] = 1.0
    """Bias above the nominal breakdown voltage (V)."""
    reference_v: Annotated[float, Field(gt=0)] = 1.0
    """Excess bias at which the efficiency curve and the dark count rates hold (V)."""
    onset_v: Annotated[float, Field(ge=0)] = 0.0
    """Excess bias below which nothing is counted (V)."""
    efficiency_scale_v: Annotated[float, Field(gt=0)] | None = None
    """Voltage scale of the saturation of the efficiency (V); null: independent of bias."""
    dark_efold_v: Annotated[float, Field(gt=0)] | None = None
    """Rise in bias that multiplies dark counts by e (V); null: independent of bias."""
    afterpulsing_slope: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Relative rise of trapped carriers per relative rise of excess bias; 1: as for the charge."""
    crosstalk_slope: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Relative rise of the neighbors that an avalanche fires, per relative rise of excess bias."""
    breakdown_sigma_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the breakdown voltage over the pixels (V)."""

    @model_validator(mode="after")
    def _check_onset(self) -> Self:
        if self.onset_v >= self.reference_v:
            raise ValueError(
                f"bias.onset_v: {self.onset_v:g} is not below reference_v {self.reference_v:g}, "
                "where the efficiency curve holds; lower it"
            )
        if self.is_on and not self.matters:
            raise ValueError(
                f"bias: excess_v {self.excess_v:g}, reference_v {self.reference_v:g}, "
                f"breakdown_sigma_v {self.breakdown_sigma_v:g}, but nothing depends on bias; give "
                "efficiency_scale_v, dark_efold_v, onset_v, afterpulsing_slope or crosstalk_slope"
            )
        return self

    @property
    def is_on(self) -> bool:
        """True if any pixel is not at the reference bias."""
        return self.excess_v != self.reference_v or self.breakdown_sigma_v > 0

    @property
    def matters(self) -> bool:
        """True if anything depends on the excess bias."""
        scales = self.efficiency_scale_v, self.dark_efold_v
        slopes = self.onset_v, self.afterpulsing_slope, self.crosstalk_slope
        return scales != (None, None) or any(slopes)


Dependence = Callable[[Bias, ArrayLike], Floats]
"""Factor on a quantity, for pixels of given breakdown voltages above nominal, V."""


def breakdown_offset(bias: Bias, shape: tuple[int, int], device_seed: int) -> Floats:
    """Breakdown voltage of every pixel relative to the nominal one, V, (rows, columns)."""
    if bias.breakdown_sigma_v == 0:
        return np.zeros(shape)
    return bias.breakdown_sigma_v * pixel_normals(shape, device_seed, "breakdown voltage")


def efficiency_factor(bias: Bias, breakdown_offset_v: ArrayLike) -> Floats:
    """Efficiency relative to that at the reference bias."""
    excess = bias.excess_v - np.asarray(breakdown_offset_v, np.float64)
    is_sensitive = excess > bias.onset_v
    if bias.efficiency_scale_v is None:
        return np.asarray(is_sensitive, np.float64)
    trigger, at_reference = (
        -np.expm1(-np.maximum(volts - bias.onset_v, 0) / bias.efficiency_scale_v)
        for volts in (excess, bias.reference_v)
    )
    return np.asarray(trigger / at_reference)


def dark_count_factor(bias: Bias, breakdown_offset_v: ArrayLike) -> Floats:
    """Dark count rate relative to that at the reference bias."""
    excess = bias.excess_v - np.asarray(breakdown_offset_v, np.float64)
    is_sensitive = excess > bias.onset_v
    if bias.dark_efold_v is None:
        return np.asarray(is_sensitive, np.float64)
    with np.errstate(over="ignore"):  # `draw_fixed_pattern` refuses rates that are not finite
        growth = np.exp((excess - bias.reference_v) / bias.dark_efold_v)
    return np.where(is_sensitive, growth, 0.0)


def charge_factor(slope: float, bias: Bias, breakdown_offset_v: ArrayLike) -> Floats:
    """Trapped carriers, or fired neighbors, relative to those at the reference bias."""
    rise = (bias.excess_v - np.asarray(breakdown_offset_v, np.float64)) / bias.reference_v - 1
    return np.maximum(1 + slope * rise, 0.0)


def since_measurement(factor: Dependence, bias: Bias, breakdown_offset_v: ArrayLike) -> Floats:
    """Apply one of the factors above to a map measured at the reference bias.

    In a pixel below the onset at that bias the factor is 1.
    """
    at_reference = bias.model_copy(update={"excess_v": bias.reference_v})
    now, then = (factor(at_bias, breakdown_offset_v) for at_bias in (bias, at_reference))
    return np.divide(now, then, out=np.ones_like(now), where=then > 0)


def best_excess_bias(bias: Bias) -> float:
    """Excess bias, V, at which efficiency over dark count rate is largest.

    Raises ValueError if efficiency or dark counts do not depend on bias.
    """
    scale, efold = bias.efficiency_scale_v, bias.dark_efold_v
    if scale is None or efold is None:
        raise ValueError(
            f"bias: efficiency_scale_v {scale} and dark_efold_v {efold}; give both, as the best "
            "bias needs both"
        )
    return bias.onset_v + scale * float(np.log1p(efold / scale))


class Temperature(Effect, frozen=True):
    """Temperature of the chip; by default that at which the dark counts hold."""

    celsius: Annotated[float, Field(gt=-273.15, le=1000)] = 20.0
    """Temperature of the chip (°C)."""
    reference_celsius: Annotated[float, Field(gt=-273.15, le=1000)] = 20.0
    """Temperature at which the dark count rates hold (°C)."""
    dcr_doubling_k: Annotated[float, Field(gt=0)] = 9.0
    """Rise in temperature that doubles the dark count rate (K)."""
    breakdown_v_per_k: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Rise of the breakdown voltage per kelvin (V/K), by which the excess bias falls."""

    @property
    def is_on(self) -> bool:
        """True if it differs from the temperature at which the dark counts hold."""
        return self.celsius != self.reference_celsius

    @property
    def dark_count_factor(self) -> float:
        """Dark count rate relative to that at the reference temperature."""
        rise_k = self.celsius - self.reference_celsius
        with np.errstate(over="ignore"):  # `draw_fixed_pattern` refuses rates that are not finite
            return float(np.exp2(rise_k / self.dcr_doubling_k))
