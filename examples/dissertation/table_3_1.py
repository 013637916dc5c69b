"""
Table 3.1: dark current suppression of the CTIA pixel
=====================================================

Non-adaptive: an offset anywhere between two DAC codes. Poor: 10 to 20 mV (Si, where 15 mV defines
the preset) and 15 to 20 mV (InGaAs). Fine: the end of the programming loop of §3.3.2, from a start
anywhere within a pulse of 500 µV. It pulses the gate while a pulse lowers the current, measured
between 90 % and 10 % of the swing, by more than 1 %. Printed: mean, and 95 % of these offsets.
"""

import numpy as np

from megalopta.sensor import PHOTODIODES, DacBias, FloatingGateBias
from megalopta.sensor.ctia import integration as ctia

GATE, PATIENCE_S, OFFSETS = FloatingGateBias(), 3600.0, (np.arange(200) + 0.5) / 200
POOR_V = {"si": (10e-3, 20e-3), "ingaas": (15e-3, 20e-3)}
STATED_A = {"si": (10.4e-15, 1.6e-12, 33.8e-15), "ingaas": (700e-12, 5.8e-9, 2.25e-12)}


def pixel(diode: str, bias_v: float | np.ndarray, drift_v_s: float = 0.0) -> ctia.Pixel:
    """The fabricated pixel of §3.2.4 (10 pF, 130 dB)."""
    return ctia.Pixel(PHOTODIODES[diode], 1e-11, 3.3, ctia.gain_from_db(130.0), bias_v, drift_v_s)


def tuned(diode: str, bias_v: float) -> float:
    """Least current that the programming loop measures, A."""
    log_a = list[float]()
    while len(log_a) < 2 or 0 < log_a[-1] < 0.99 * log_a[-2]:
        now = pixel(diode, bias_v, GATE.leak_v_s)
        taken_s = min(float(ctia.discharge_time(now, 0.0, ctia.LATE * now.swing_v)), PATIENCE_S)
        log_a.append(float(ctia.estimate_current(now)) * (taken_s < PATIENCE_S))
        bias_v += GATE.leak_v_s * (taken_s + GATE.pulse_s) - GATE.step_v
    return min(current_a for current_a in log_a if current_a > 0)


for diode, stated_a in STATED_A.items():
    currents_a = {
        "non-adaptive": ctia.estimate_current(pixel(diode, OFFSETS * DacBias().step_v)),
        "poor": ctia.estimate_current(pixel(diode, np.linspace(*POOR_V[diode]), GATE.leak_v_s)),
        "fine": np.array([tuned(diode, 18.7e-3 + part * GATE.step_v) for part in OFFSETS[::50]]),
    }
    for dissertation_a, (state, here_a) in zip(stated_a, currents_a.items(), strict=True):
        low, high = np.percentile(here_a, (2.5, 97.5))
        measured = f"{here_a.mean():.3g} A ({low:.3g} to {high:.3g})"
        print(f"{diode}, {state}: dissertation {dissertation_a:.3g} A; here {measured}")
    # 0.8/(√1.8 − √0.2)·√(Q·g·r) of the charge Q, a conductance g at zero bias and a leak r
    charge_leak = 3.3 * 1e-11 * PHOTODIODES[diode].zero_bias_s * GATE.leak_v_s
    limit = f"{0.8 / (1.8**0.5 - 0.2**0.5) * charge_leak**0.5:.3g} A, exact"
    print(f"{diode}, limit set by the leak: dissertation not stated; here {limit}")
