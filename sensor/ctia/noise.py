"""Noise of a CTIA reading, in volts at the output of the pixel.

- photon shot noise: the photoelectrons are Poisson, variance q·I_ph·t in C²;
- dark shot noise: two opposite Poisson currents of the junction (`junction_currents`), and the
  thermal noise of the shunt, variance 2·k·T·t/R (C²). It stays at zero bias, where the net current
  is zero: bias tuning removes the dark current, but not the thermal noise of its conductance;
- reset (kTC) noise: k·T/C in V², unless the reset level is read too and subtracted;
- read noise: normal, from everything after the pixel.

The bias is taken in the middle of the discharge. Sources and approximations: `docs/theory/ctia.md`.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.sensor.ctia.integration import Pixel, discharge, reverse_bias, start
from megalopta.sensor.ctia.photodiode import (
    BOLTZMANN_J_K,
    ELEMENTARY_CHARGE_C,
    junction_currents,
    noise_current,
)


class CtiaNoise(Record):
    """Noise terms of a CTIA reading."""

    photon_shot: bool = True
    """Photon shot noise."""
    dark_shot: bool = True
    """Noise of the dark diode: shot noise of its junction, thermal noise of its shunt."""
    reset: bool = True
    """kTC noise of resetting the capacitor; off: the reset level is subtracted."""
    read_noise_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of everything after the pixel (V); 0: none."""


def draw_noise(
    rng: np.random.Generator, noise: CtiaNoise, pixel: Pixel, photocurrent_a: Floats, time_s: float
) -> Floats:
    """Draw the deviation of readings from the noise-free discharge, V.

    `photocurrent_a`: A, one per pixel; `time_s`: since reset.
    """
    elapsed, bias = _halfway(pixel, photocurrent_a, time_s)
    volts = np.zeros(np.broadcast_shapes(np.shape(photocurrent_a), elapsed.shape))
    if noise.photon_shot:
        volts += poisson_charge(rng, photocurrent_a * elapsed) / pixel.capacitance_f
    if noise.dark_shot:
        volts += _dark_charge(rng, pixel, bias, elapsed) / pixel.capacitance_f
    normal = reset_variance(noise, pixel) + noise.read_noise_v**2
    if normal > 0:
        volts += rng.normal(0.0, np.sqrt(normal), volts.shape)
    return volts


def noise_variance(noise: CtiaNoise, pixel: Pixel, photocurrent_a: Floats, time_s: float) -> Floats:
    """Variance of `draw_noise`, V²; its mean is 0."""
    elapsed, bias = _halfway(pixel, photocurrent_a, time_s)
    equivalent = noise_current(pixel.diode, bias, pixel.dark_scale)
    shot = noise.photon_shot * photocurrent_a + noise.dark_shot * equivalent
    charge = ELEMENTARY_CHARGE_C * shot * elapsed
    return np.asarray(
        charge / pixel.capacitance_f**2 + reset_variance(noise, pixel) + noise.read_noise_v**2
    )


def _halfway(pixel: Pixel, photocurrent_a: Floats, time_s: float) -> tuple[Floats, Floats]:
    """Time during which the output moves, s, and the reverse bias in the middle of it, V."""
    wait, bias = start(pixel, photocurrent_a)
    elapsed = np.maximum(time_s - wait, 0.0)
    middle = np.where(elapsed > 0, time_s - elapsed / 2, 0.0)
    discharged = discharge(pixel, photocurrent_a, time_s) / 2
    return elapsed, np.maximum(reverse_bias(pixel, middle, discharged), bias)


def _dark_charge(rng: np.random.Generator, pixel: Pixel, bias: Floats, elapsed: Floats) -> Floats:
    diode = pixel.diode
    time = np.asarray(pixel.dark_scale) * elapsed
    reverse, forward = junction_currents(diode, bias)
    charge = poisson_charge(rng, reverse * time)
    charge -= poisson_charge(rng, forward * time)
    if diode.shunt_ohm is not None:
        conductance = diode.shunt_s * np.asarray(pixel.dark_scale)
        variance = 2 * BOLTZMANN_J_K * diode.temperature_k * conductance * elapsed
        charge += rng.normal(0.0, np.sqrt(np.broadcast_to(variance, charge.shape)))
    return charge


def poisson_charge(rng: np.random.Generator, charge: Floats) -> Floats:
    """Charge of a Poisson number of electrons minus its mean, C."""
    electrons = charge / ELEMENTARY_CHARGE_C
    return np.asarray(ELEMENTARY_CHARGE_C * (rng.poisson(electrons) - electrons))


def reset_variance(noise: CtiaNoise, pixel: Pixel) -> float:
    """Variance of the reset voltage, kT/C, V²."""
    kelvin = pixel.diode.temperature_k
    return noise.reset * BOLTZMANN_J_K * kelvin / pixel.capacitance_f
