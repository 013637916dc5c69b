"""Discharge of a CTIA pixel: integration on a capacitor with an amplifier of finite gain.

    C·ds/dt = I_ph + I_dark(v)            s = V_out(0) − V_out, the discharge
    v = v_0 + drift·t + s/A               reverse bias of the diode; A: open-loop gain

A drift is the leak of a floating gate that sets the bias. Without a shunt the equation has a closed
form, also with drift: with w = n·k·T/q, J = I_ph + I_s + A·C·drift and κ the share of J that flows
at the start,

    s = A·(w·ln(1 + κ·(exp(J·t/(A·w·C)) − 1)) − drift·t)

With a shunt there is none. The equation is then integrated by the classical Runge-Kutta method in
64 equal steps per pixel, so that a result does not depend on which pixels are computed together.
Over a full swing at 40 dB the error is below 1e-6 of the swing from 1 mV; from 1 µV, where the
current grows by a factor of e¹⁰, it is 6e-5, and from 1 nV 6e-4. Where bias and current change by
less than 1 %, as in an exposure of the built pixel at 130 dB, one step is exact to 1e-10.

A diode that starts in forward bias drives the output against the upper rail, where it stays until a
drift has brought the current back to zero; the lower rail, s = swing, ends the discharge. Source
and assumptions: `docs/theory/ctia.md`.
"""

from dataclasses import dataclass

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor.ctia.photodiode import (
    Photodiode,
    Reals,
    open_circuit_voltage,
    reverse_current,
)

EARLY, LATE = 0.1, 0.9
"""Discharged fractions of the swing (output at 90 % and 10 %) between which time is measured."""

STEPS = 64
_LARGE, _TINY = 30.0, 1e-300
_LITTLE = 0.01


@dataclass(frozen=True, eq=False)
class Pixel:
    """One pixel, or many: arrays broadcast against each other."""

    diode: Photodiode
    capacitance_f: float
    """Capacitance of the integration capacitor (F)"""
    swing_v: float
    """Voltage from reset to the lower rail (V)"""
    gain: Reals
    """Open-loop gain of the amplifier (V/V)"""
    bias_v: Reals
    """Reverse bias of the diode at reset (V); negative: forward"""
    drift_v_s: float = 0.0
    """Rise of the reverse bias (V/s), not negative, so that the discharge cannot reverse"""
    dark_scale: Reals = 1.0
    """Factor on the dark current of the diode"""


def gain_from_db(gain_db: Reals) -> Floats:
    """Voltage gain (V/V) from decibels, of any shape."""
    return np.asarray(10 ** (np.asarray(gain_db, np.float64) / 20))


def discharge(pixel: Pixel, photocurrent_a: Reals, time_s: Reals) -> Floats:
    """Return the voltage drop of the output after a time, V, of any shape, up to the swing.

    `photocurrent_a`: A, not negative; `time_s`: since reset.
    """
    volts = _free_discharge(pixel, photocurrent_a, time_s)
    return np.minimum(volts, pixel.swing_v)


def discharge_time(pixel: Pixel, photocurrent_a: Reals, discharged_v: Reals) -> Floats:
    """Time from reset until the output has dropped by a voltage, s; infinite if it never does.

    Arrays of any shape. Newton's method converges, as the current only grows and the discharge is
    convex in time.

    Raises ValueError if the requested discharge is not within the swing.
    """
    target = np.asarray(discharged_v, np.float64)
    if not np.all((target > 0) & (target <= pixel.swing_v)):
        raise ValueError(
            f"discharged_v: {target.tolist()}; must be above 0 and at most the swing, "
            f"{pixel.swing_v:g} V"
        )
    wait, bias = start(pixel, photocurrent_a)
    # first a full swing at the first current, or at one that grows by the drift alone
    charge = pixel.capacitance_f * pixel.swing_v
    steady = photocurrent_a + reverse_current(pixel.diode, bias, pixel.dark_scale)
    growth = pixel.diode.zero_bias_s * np.asarray(pixel.dark_scale) * pixel.drift_v_s
    with np.errstate(divide="ignore"):
        swing_s = np.minimum(charge / np.maximum(steady, 0.0), np.sqrt(2 * charge / growth))
    time = wait + swing_s + 0 * target
    seeking = np.isfinite(time)
    for _ in range(100):  # Newton steps
        # each pixel separately, so that results do not depend on which are computed together
        now = np.where(seeking, time, 0.0)
        volts = _free_discharge(pixel, photocurrent_a, now)
        held = volts if pixel.diode.shunt_ohm is None else np.minimum(volts, pixel.swing_v)
        dark_a = reverse_current(pixel.diode, reverse_bias(pixel, now, held), pixel.dark_scale)
        with np.errstate(invalid="ignore", divide="ignore"):
            step = pixel.capacitance_f * (target - volts) / (photocurrent_a + dark_a)
        step = np.where(seeking, step, 0.0)
        time = np.where(seeking, np.maximum(time + step, wait), time)
        seeking &= np.abs(step) > 1e-12 * time  # relative error
        if not seeking.any():
            break
    return np.asarray(time)


def reverse_bias(pixel: Pixel, time_s: Reals, discharged_v: Reals) -> Floats:
    """Reverse bias of the diode at a time and discharge, V."""
    moved = np.asarray(discharged_v) / np.asarray(pixel.gain)
    return np.asarray(pixel.bias_v + pixel.drift_v_s * np.asarray(time_s) + moved)


def estimate_current(pixel: Pixel, photocurrent_a: Reals = 0.0) -> Floats:
    """Current as measured on the bench, C·ΔV/Δt from 90 % to 10 % of the swing, A.

    Any shape; 0 where the pixel does not discharge.
    """
    early, late = (
        discharge_time(pixel, photocurrent_a, share * pixel.swing_v) for share in (EARLY, LATE)
    )
    charge = pixel.capacitance_f * (LATE - EARLY) * pixel.swing_v
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(late), charge / (late - early), 0.0)


def start(pixel: Pixel, photocurrent_a: Reals) -> tuple[Floats, Floats]:
    """Time at which the output leaves the upper rail, s, and the reverse bias then, V.

    0 if current flows in the right direction; infinite if the diode is in forward bias without
    drift.
    """
    bias = np.asarray(pixel.bias_v, np.float64)
    if np.all(bias >= 0):  # the balance, which takes a Newton iteration, is never above 0
        shape = np.broadcast_shapes(*map(np.shape, (photocurrent_a, bias, pixel.dark_scale)))
        return np.zeros(shape), np.broadcast_to(bias, shape)
    balance = -open_circuit_voltage(pixel.diode, photocurrent_a, pixel.dark_scale)
    short = np.maximum(balance - bias, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        wait = np.where(short > 0, short / pixel.drift_v_s, 0.0)
    return wait, np.maximum(bias, balance)


def _free_discharge(pixel: Pixel, photocurrent_a: Reals, time_s: Reals) -> Floats:
    """Discharge as if there were no lower rail; beyond it the current stays constant."""
    wait, bias = start(pixel, photocurrent_a)
    elapsed = np.maximum(np.asarray(time_s, np.float64) - wait, 0.0)
    solve = _closed_form if pixel.diode.shunt_ohm is None else _runge_kutta
    return solve(pixel, np.asarray(photocurrent_a, np.float64), bias, elapsed)


def _closed_form(pixel: Pixel, photocurrent_a: Floats, bias: Floats, elapsed: Floats) -> Floats:
    gain, slope = np.asarray(pixel.gain, np.float64), pixel.diode.slope_v
    leak = gain * pixel.capacitance_f * pixel.drift_v_s
    saturation = pixel.diode.saturation_current_a * np.asarray(pixel.dark_scale)
    total = photocurrent_a + saturation + leak
    at_start = photocurrent_a + leak + reverse_current(pixel.diode, bias, pixel.dark_scale)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(total > 0, at_start / total, 0.0)
    exponent = total * elapsed / (gain * slope * pixel.capacitance_f)
    low = np.log1p(share * np.expm1(np.minimum(exponent, _LARGE)))
    # overflow-safe form; ln(0) is not reached: where the share is 0 nothing elapses
    high = exponent + np.log(np.maximum(share + (1 - share) * np.exp(-exponent), _TINY))
    risen = slope * np.where(exponent > _LARGE, high, low)
    return np.asarray(gain * (risen - pixel.drift_v_s * elapsed))


def _runge_kutta(pixel: Pixel, photocurrent_a: Floats, bias: Floats, elapsed: Floats) -> Floats:
    # the diode's curve is straight enough over the bias range for one step
    diode, gain = pixel.diode, np.asarray(pixel.gain, np.float64)
    junction = diode.saturation_current_a / diode.slope_v * np.exp(-bias / diode.slope_v)
    conductance = np.asarray(pixel.dark_scale) * (junction + diode.shunt_s)
    grows = conductance * elapsed / (gain * pixel.capacitance_f)
    moves = (pixel.drift_v_s * elapsed + pixel.swing_v / gain) / diode.slope_v
    brief = np.asarray((grows < _LITTLE) & (moves < _LITTLE))
    volts = _steps(pixel, photocurrent_a, bias, elapsed, 1)
    if brief.all():
        return volts
    # per pixel, although both are computed for all: no result depends on its neighbors
    return np.where(brief, volts, _steps(pixel, photocurrent_a, bias, elapsed, STEPS))


def _steps(
    pixel: Pixel, photocurrent_a: Floats, bias: Floats, elapsed: Floats, steps: int
) -> Floats:
    gain = np.asarray(pixel.gain, np.float64)
    step = elapsed / steps
    volts = np.zeros(np.broadcast_shapes(*map(np.shape, (photocurrent_a, bias, elapsed, gain))))

    def slope(time: Floats, volts: Floats) -> Floats:
        held = np.minimum(volts, pixel.swing_v)
        moved = bias + pixel.drift_v_s * time + held / gain
        dark = reverse_current(pixel.diode, moved, pixel.dark_scale)
        return np.asarray((photocurrent_a + dark) / pixel.capacitance_f)

    for index in range(steps):
        time = index * step
        first = slope(time, volts)
        second = slope(time + step / 2, volts + step / 2 * first)
        third = slope(time + step / 2, volts + step / 2 * second)
        fourth = slope(time + step, volts + step * third)
        volts = volts + step / 6 * (first + 2 * second + 2 * third + fourth)
    return volts
