"""How the bias of CTIA pixels is set, against doing it by hand: code by code, pulse by pulse."""

from collections.abc import Iterator

import numpy as np

from megalopta.sensor import changed
from megalopta.sensor.ctia import (
    CtiaNoise,
    DacBias,
    FixedBias,
    FloatingGateBias,
    Photodiode,
    Pixel,
    calibrate,
    ctia_preset,
    gain_from_db,
    leak_floor,
    trimmed_bias,
    volt_moments,
)
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck.comparison import Row, exact_row

_SHUNT_OHM, _FARAD, _SWING_V = 1e9, 10e-12, 3.3


def check_trimming() -> Iterator[Row]:
    """Bias that is left of a thousand offsets, some of which no pulse can trim."""
    offsets = 30e-3 * generator(10, "offsets").standard_normal(1000)
    for target in (0.0, 7e-3):
        dac = DacBias(target_v=target)
        every = dac.reference_v + offsets[:, None] - dac.rail_v / 4096 * np.arange(4096)
        smallest = np.where(every >= target, every, np.inf).min(1)
        gate = FloatingGateBias(erased_v=30e-3, target_v=target, age_s=100.0, warming_k=2.0)
        aged = 1.5e-6 * 100 + 1e-3 * 2
        pulsed = [_pulsed(each + 30e-3 - target, 0.5e-3) + target + aged for each in offsets]
        for name, bias, expected in (
            ("converter", dac, smallest),
            ("floating gate", gate, pulsed),
            ("fixed", FixedBias(reverse_bias_v=target), offsets + target),
        ):
            off = float(np.abs(trimmed_bias(bias, offsets) - expected).max())
            quantity = f"{name}, target {target:g} V, largest difference (V)"
            yield exact_row("CTIA bias", quantity, 0.0, off, 1e-12)


def check_pulse_loop() -> Iterator[Row]:
    """Measure, pulse, measure: a pixel with a shunt alone, whose discharge is a parabola."""
    gate = FloatingGateBias()
    # an amplifier so good that the bias moves by the leak of the gate alone
    pixel = Pixel(Photodiode(shunt_ohm=_SHUNT_OHM), _FARAD, _SWING_V, 1e12, 18.7e-3)
    log = calibrate(gate, pixel)
    currents, elapsed_s = _tuned_by_hand(18.7e-3)
    yield exact_row("CTIA pulse loop", "pulses", len(currents) - 1, len(log) - 1, 1e-9)
    expected = 1e15 * currents[-2]
    measured = 1e15 * log[-2].current_a
    yield exact_row("CTIA pulse loop", "tuned current (fA)", expected, measured, 1e-5 * expected)
    yield exact_row(
        "CTIA pulse loop", "time taken (s)", elapsed_s, log[-1].elapsed_s, 1e-5 * elapsed_s
    )


def check_leak_floor() -> Iterator[Row]:
    """Smallest current that a leaking gate lets be seen: a parabola from zero bias; decibels."""
    leak = 1.5e-6
    pixel = Pixel(Photodiode(shunt_ohm=_SHUNT_OHM), _FARAD, _SWING_V, 1e12, 0.0, leak)
    early, late = (_parabola(0.0, leak, share * _SWING_V) for share in (0.1, 0.9))
    floor = 1e15 * _FARAD * 0.8 * _SWING_V / (late - early)
    found = 1e15 * leak_floor(pixel)
    yield exact_row("CTIA pulse loop", "leak floor (fA)", floor, found, 1e-9 * floor)
    yield exact_row(
        "CTIA gain", "decades of 130 dB", 6.5, float(np.log10(gain_from_db(130.0))), 1e-9
    )


def check_gate_leak() -> Iterator[Row]:
    """Discharge of frames as the gate leaks, again a parabola."""
    silent = CtiaNoise(photon_shot=False, dark_shot=False, reset=False)
    sensor = changed(
        ctia_preset("ctia_si"),
        diode=Photodiode(shunt_ohm=_SHUNT_OHM),
        gain_db=200.0,
        gain_sigma_db=0.0,
        offset_sigma_v=0.0,
        dark_sigma=0.0,
        noise=silent,
    )
    leaks = changed(sensor, bias=FloatingGateBias(leak_v_s=1e-3))
    stays = changed(sensor, bias=FixedBias())
    frames = 100
    dark = np.zeros((frames, 1, 1))
    aged, fresh = (volt_moments(dark, each)[0][:, 0, 0] for each in (leaks, stays))
    seconds, age = sensor.exposure_s, (frames - 1) * sensor.exposure_s
    start = _pulsed(18.7e-3, 0.5e-3)
    for name, expected, measured in (
        ("frame 99", start + 1e-3 * (age + seconds / 2), aged[-1]),
        ("frame 99, bias held", 18.7e-3, fresh[-1]),
    ):
        volts = expected * seconds / (_SHUNT_OHM * _FARAD)
        yield exact_row("CTIA gate leak", f"{name} (V)", volts, float(measured), 1e-5 * volts)


def _pulsed(bias_v: float, step_v: float) -> float:
    while bias_v - step_v >= 0:
        bias_v -= step_v
    return bias_v


def _tuned_by_hand(bias_v: float) -> tuple[list[float], float]:
    """Currents that the loop sees until one is no more than 1 % lower, A, and the time it takes."""
    leak, step, pulse_s = 1.5e-6, 0.5e-3, 1e-3
    currents: list[float] = []
    elapsed = 0.0
    while len(currents) < 2 or currents[-1] < 0.99 * currents[-2]:
        # at the upper rail until the leak has brought the bias back to zero
        wait, start = max(-bias_v / leak, 0.0), max(bias_v, 0.0)
        early, late = (_parabola(start, leak, share * _SWING_V) for share in (0.1, 0.9))
        currents.append(_FARAD * 0.8 * _SWING_V / (late - early))
        spent = wait + late + pulse_s
        elapsed += spent
        bias_v += leak * spent - step
    return currents, elapsed - pulse_s


def _parabola(bias_v: float, leak_v_s: float, volts: float) -> float:
    """Time at which (b·t + r·t²/2)/(R·C) reaches a discharge."""
    root = np.sqrt(bias_v**2 + 2 * leak_v_s * volts * _SHUNT_OHM * _FARAD)
    return float((root - bias_v) / leak_v_s)
