"""CTIA pixels against an integrator of differential equations, and noise against its physics.

The equation of the pixel is written out again here and left to SciPy. Noise is held against
statements that do not come from the model: electrons that arrive one by one are Poisson (reverse
bias), a conductor in equilibrium has the noise of Nyquist, 4·k·T·g (zero bias), a capacitor holds
k·T/2 (reset).
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.constants import e, k
from scipy.integrate import solve_ivp

from megalopta.core.arrays import Floats
from megalopta.sensor import changed
from megalopta.sensor.ctia import (
    CtiaNoise,
    CtiaSensor,
    FixedBias,
    Photodiode,
    Pixel,
    ctia_preset,
    discharge,
    discharge_time,
    estimate_current,
    expose_photocurrent,
    noise_current,
    pixels,
    reading_electrons,
)
from megalopta.sensor.optics import Efficiency
from megalopta.sensor.selfcheck.comparison import Row, exact_row, mean_row, variance_row

_SWING_V = 3.3
_KELVIN = 300.0
_JUNCTION_A = 100e-12
_SHUNT_OHM = 588.6e3
_SHAPE = (1, 300, 300)


def check_ctia_discharge() -> Iterator[Row]:
    """Output after part of a discharge: straight, bent by a poor amplifier, held at its rail."""
    junction = Photodiode(saturation_current_a=_JUNCTION_A)
    both = Photodiode(saturation_current_a=_JUNCTION_A, shunt_ohm=_SHUNT_OHM)
    # name, pixel, photocurrent (A), time (s), tolerance (V)
    cases = (
        ("junction, 130 dB", Pixel(junction, 1e-11, _SWING_V, 10**6.5, 5e-3), 1e-11, 0.5, 1e-7),
        ("junction, 40 dB", Pixel(junction, 1e-13, _SWING_V, 100.0, 1e-3), 0.0, 8e-3, 1e-7),
        ("shunt, 40 dB", Pixel(both, 1e-11, _SWING_V, 100.0, 1e-3), 1e-12, 1e-3, 3e-6),
        ("leaking gate, 60 dB", Pixel(junction, 1e-12, _SWING_V, 1e3, 1e-3, 1e-3), 0.0, 0.2, 1e-7),
        (
            "forward start, leaking gate",
            Pixel(both, 1e-12, _SWING_V, 1e5, -1e-3, 1e-3),
            0.0,
            1.03,
            3e-6,
        ),
        *(
            (
                f"forward start in light, {kind}",
                Pixel(diode, 1e-11, _SWING_V, 1e5, -0.15, 1e-3),
                1e-10,
                seconds,
                1e-5,
            )
            for kind, diode, seconds in (
                ("junction", junction, 134.0),
                ("shunt", Photodiode(shunt_ohm=1e9), 56.0),
                ("both", changed(junction, shunt_ohm=1e9), 136.5),
            )
        ),
    )
    for name, pixel, light_a, time_s, tolerance in cases:
        measured = float(discharge(pixel, light_a, time_s))
        expected = _integrated(pixel, light_a, time_s)
        yield exact_row("CTIA discharge", f"{name} (V)", expected, measured, tolerance)


def check_ctia_times() -> Iterator[Row]:
    """Time of a discharge, and the current estimated from it, against the discharge over time."""
    junction = Photodiode(saturation_current_a=_JUNCTION_A, ideality=1.5)
    shunted = changed(junction, shunt_ohm=1e9)
    for name, diode, gain in (("junction", junction, 100.0), ("shunt", shunted, 1e3)):
        pixel = Pixel(diode, 1e-13, _SWING_V, gain, 5e-3, 1e-3)
        light = np.array([0.0, 1e-12, 1e-10])
        shares = np.array([[0.1], [0.5], [0.9], [1.0]])
        times = discharge_time(pixel, light, shares * _SWING_V)
        found = discharge(pixel, light, times) / _SWING_V
        off = float(np.abs(found / shares - 1).max())
        yield exact_row("CTIA discharge", f"{name}, largest error of times", 0.0, off, 1e-8)
        expected = 1e-13 * 0.8 * _SWING_V / (times[2] - times[0])
        off = float(np.abs(estimate_current(pixel, light) / expected - 1).max())
        yield exact_row("CTIA discharge", f"{name}, largest error of a current", 0.0, off, 1e-9)


def check_ctia_noise() -> Iterator[Row]:
    """Mean and variance of readings, each kind of noise alone."""
    time_s, farad, light_a = 0.1, 10e-12, 1e-13
    photons = light_a * time_s / e
    light = _electrons(Photodiode(), 0.0, light_a, CtiaNoise(dark_shot=False, reset=False))
    yield mean_row("CTIA photon shot noise", "electrons", photons, light)
    yield variance_row("CTIA photon shot noise", "variance (electrons²)", photons, light)
    junction = Photodiode(saturation_current_a=_JUNCTION_A, temperature_k=_KELVIN)
    dark_only = CtiaNoise(photon_shot=False, reset=False)
    thermal = changed(junction, shunt_ohm=_SHUNT_OHM)
    conductance = _JUNCTION_A * e / (k * _KELVIN) + 1 / _SHUNT_OHM
    nyquist = 2 * k * _KELVIN * conductance * time_s / e**2
    at_zero = _electrons(thermal, 0.0, 0.0, dark_only)
    yield mean_row("CTIA dark noise", "electrons at zero bias", 0.0, at_zero)
    yield variance_row("CTIA dark noise", "variance at zero bias (electrons²)", nyquist, at_zero)
    recombining = _electrons(changed(junction, ideality=2.0), 0.0, 0.0, dark_only)
    nyquist = 2 * k * _KELVIN * (_JUNCTION_A * e / (2 * k * _KELVIN)) * time_s / e**2
    yield variance_row("CTIA dark noise", "variance at zero bias, n = 2", nyquist, recombining)
    for bias_v in (-0.05, 0.02, 0.3):  # forward and reverse currents are as e^(qV/kT), whatever n
        diode = changed(junction, ideality=1.7)
        net = -_JUNCTION_A * np.expm1(-bias_v * e / (1.7 * k * _KELVIN))
        both = float(net / np.tanh(bias_v * e / (2 * k * _KELVIN)))
        found = float(noise_current(diode, bias_v))
        yield exact_row(
            "CTIA dark noise", f"current at {bias_v} V, n = 1.7", both, found, 1e-9 * both
        )
    reverse = _electrons(junction, 1.0, 0.0, dark_only)
    full = _JUNCTION_A * time_s / e
    yield mean_row("CTIA dark noise", "electrons at 1 V reverse", full, reverse)
    yield variance_row("CTIA dark noise", "variance at 1 V reverse (electrons²)", full, reverse)
    reset = _electrons(Photodiode(), 0.0, 0.0, CtiaNoise(photon_shot=False, dark_shot=False))
    microvolts = reset * e / farad * 1e6
    yield variance_row(
        "CTIA reset noise", "variance (µV²), k·T/C", k * _KELVIN / farad * 1e12, microvolts
    )


def check_ctia_pattern() -> Iterator[Row]:
    """How the pixels of an array differ: offsets, gains in decibels, dark currents."""
    sensor = changed(ctia_preset("ctia_si"), bias=FixedBias(reverse_bias_v=5e-3), dark_sigma=0.3)
    found = pixels(sensor, (300, 300))
    for name, mean, sigma, values in (
        ("bias (mV)", 18.7 + 5, 10.0, 1e3 * np.asarray(found.bias_v)),
        ("gain (dB)", 130.0, 3.4, 20 * np.log10(found.gain)),
        ("dark current, factor", 1.0, 0.3, np.asarray(found.dark_scale)),
    ):
        yield mean_row("CTIA pixels", f"mean {name}", mean, values)
        yield variance_row("CTIA pixels", f"variance, {name}", sigma**2, values)


def _electrons(diode: Photodiode, bias_v: float, light_a: float, noise: CtiaNoise) -> Floats:
    sensor = CtiaSensor(
        name="check",
        pitch_m=1e-4,
        exposure_s=0.1,
        efficiency=Efficiency(wavelengths_nm=(400, 1000), values=(1.0, 1.0)),
        diode=diode,
        gain_db=200.0,
        bias=FixedBias(reverse_bias_v=bias_v),
        noise=noise,
    )
    reading = expose_photocurrent(np.full(_SHAPE, light_a), sensor, seed=1, sequence="check")
    return reading_electrons(reading.volts, sensor)


def _integrated(pixel: Pixel, light_a: float, time_s: float) -> float:
    diode = pixel.diode
    shunt_s = 0.0 if diode.shunt_ohm is None else 1 / diode.shunt_ohm

    def slope(time_s: float, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        bias = float(pixel.bias_v) + pixel.drift_v_s * time_s + volts / float(pixel.gain)
        junction = diode.saturation_current_a * -np.expm1(-bias * e / (k * _KELVIN))
        # the upper rail holds an output that a forward current drives against it
        return np.maximum(light_a + junction + shunt_s * bias, 0.0) / pixel.capacitance_f

    solution = solve_ivp(slope, (0, time_s), [0.0], "DOP853", rtol=1e-11, atol=1e-12)
    return float(solution.y[0, -1])
