"""Photodiode of a CTIA pixel: an ideal diode with a shunt resistance.

    I_D(V) = I_s·(exp(V/(n·k·T/q)) − 1) + V/R_shunt          V = forward bias

The pixel works at a small reverse bias, so functions here take the reverse bias and return the
current that discharges the pixel: positive in reverse, negative in forward bias, where the pixel
"can no longer discharge".

Detailed balance makes the ratio of the two currents of single electrons across the junction
exp(q·V_r/(k·T)), without n.

The saturation current holds at the given temperature and is not scaled with it. Sources and
approximations: `docs/theory/ctia.md`.
"""

from typing import Annotated, TypeAlias

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.record import Record

BOLTZMANN_J_K = 1.380649e-23
ELEMENTARY_CHARGE_C = 1.602176634e-19

Reals: TypeAlias = float | Floats

# from the smaller of the two bounds below, eight reach double precision at any current ratio
_NEWTON_STEPS = 12


class Photodiode(Record):
    """Dark current of a photodiode."""

    saturation_current_a: Annotated[float, Field(ge=0)] = 0.0
    """Reverse saturation current at the given temperature (A); 0: no junction current."""
    ideality: Annotated[float, Field(ge=1, le=2)] = 1.0
    """Ideality factor n of the junction (1 to 2)."""
    temperature_k: Annotated[float, Field(gt=0)] = 300.0
    """Temperature of the junction (K)."""
    shunt_ohm: Annotated[float, Field(gt=0)] | None = None
    """Resistance in parallel to the junction (Ω); null: no shunt."""

    @property
    def slope_v(self) -> float:
        """n·k·T/q: the bias that changes the forward current by a factor e (V)."""
        return self.ideality * self.thermal_v

    @property
    def thermal_v(self) -> float:
        """k·T/q (V)."""
        return BOLTZMANN_J_K * self.temperature_k / ELEMENTARY_CHARGE_C

    @property
    def shunt_s(self) -> float:
        """Conductance of the shunt (S)."""
        return 0.0 if self.shunt_ohm is None else 1 / self.shunt_ohm

    @property
    def zero_bias_s(self) -> float:
        """Conductance at zero bias (S): I_s/(n·k·T/q) + 1/R_shunt."""
        return self.saturation_current_a / self.slope_v + self.shunt_s


def reverse_current(diode: Photodiode, reverse_bias_v: Reals, scale: Reals = 1.0) -> Floats:
    """Dark current that discharges pixels of any shape, A; negative in forward bias.

    `reverse_bias_v`: V; negative: forward; `scale`: each pixel's factor on its dark current.
    """
    bias = np.asarray(reverse_bias_v, np.float64)
    # a forward bias of some 0.7 V exceeds the current of any amplifier: infinity is correct
    with np.errstate(over="ignore"):
        junction = -diode.saturation_current_a * np.expm1(-bias / diode.slope_v)
    return np.asarray(scale * (junction + diode.shunt_s * bias))


def junction_currents(diode: Photodiode, reverse_bias_v: Reals) -> tuple[Floats, Floats]:
    """Currents across the junction in reverse and in forward direction, A.

    Their difference is the junction's part of `reverse_current`; their sum gives its shot noise.
    """
    bias = np.asarray(reverse_bias_v, np.float64)
    size = np.abs(bias) / diode.thermal_v
    # expm1(−a/n)/expm1(−a), 1/n at zero bias and exactly 1 for n = 1
    share = np.full_like(size, 1 / diode.ideality)
    np.divide(np.expm1(-size / diode.ideality), np.expm1(-size), out=share, where=size > 0)
    slower = np.exp(np.minimum(bias, 0) * (1 / diode.thermal_v - 1 / diode.slope_v))
    with np.errstate(over="ignore"):
        forward = np.exp(-bias / np.where(bias > 0, diode.thermal_v, diode.slope_v))
    current = diode.saturation_current_a * share
    return np.asarray(current * slower), np.asarray(current * forward)


def noise_current(diode: Photodiode, reverse_bias_v: Reals, scale: Reals = 1.0) -> Floats:
    """Current (A, of any shape) whose full shot noise equals the noise of the dark diode.

    Parameters as for `reverse_current`.
    """
    reverse, forward = junction_currents(diode, reverse_bias_v)
    return np.asarray(scale * (reverse + forward + 2 * diode.thermal_v * diode.shunt_s))


def open_circuit_voltage(diode: Photodiode, photocurrent_a: Reals, scale: Reals = 1.0) -> Floats:
    """Forward bias at which the diode's own current cancels the photocurrent, V.

    Newton's method on a convex function converges from above. Infinite for a diode without dark
    conduction.
    """
    photocurrent = np.asarray(photocurrent_a, np.float64)
    slope, factor = diode.slope_v, np.asarray(scale, np.float64)
    saturation, shunt = factor * diode.saturation_current_a, factor * diode.shunt_s
    if diode.zero_bias_s == 0:
        return np.full(np.broadcast_shapes(photocurrent.shape, saturation.shape), np.inf)
    if diode.saturation_current_a == 0:
        return np.asarray(photocurrent / shunt)
    voltage = np.asarray(slope * np.log1p(photocurrent / saturation))
    if diode.shunt_ohm is None:
        return voltage
    voltage = np.minimum(voltage, photocurrent / shunt)
    for _ in range(_NEWTON_STEPS):
        excess = saturation * np.expm1(voltage / slope) + shunt * voltage - photocurrent
        steepness = saturation / slope * np.exp(voltage / slope) + shunt
        voltage = voltage - excess / steepness
    return voltage
