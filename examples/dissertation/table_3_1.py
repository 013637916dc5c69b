"""
Table 3.1: dark current suppression of the CTIA pixel
=====================================================

Non-adaptive: mean over an offset anywhere between two DAC codes. Poor: the state at 15 mV (Si,
which defines the preset) and 17.5 mV (InGaAs). Fine: the end of the programming loop of §3.3.2,
which pulses the gate while a pulse of 500 µV lowers the current, measured between 90 % and 10 % of
the swing, by more than 1 %. Last column: the least current with a leak of 1.5 µV/s.
"""

import numpy as np

from megalopta.sensor import CTIA_PRESETS, PHOTODIODES, DacBias, FloatingGateBias
from megalopta.sensor.ctia import integration as ctia

GATE, PATIENCE_S, OFFSETS = FloatingGateBias(), 3600.0, (np.arange(200) + 0.5) / 200
POOR_V, PRINTED = (15e-3, 17.5e-3), ("10.4 fA, 1.6 pA, 33.8 fA", "700 pA, 5.8 nA, 2.25 pA")


def pixel(diode: str, bias_v: float | np.ndarray, drift_v_s: float = 0.0) -> ctia.Pixel:
    """The fabricated pixel of §3.2.4 (10 pF, 130 dB)."""
    return ctia.Pixel(PHOTODIODES[diode], 1e-11, 3.3, ctia.gain_from_db(130.0), bias_v, drift_v_s)


def tuned(diode: str, bias_v: float) -> tuple[float, float]:
    """Least current that the programming loop measures, A, and when, s."""
    log, elapsed_s = list[tuple[float, float]](), 0.0
    while len(log) < 2 or 0 < log[-1][0] < 0.99 * log[-2][0]:
        now = pixel(diode, bias_v, GATE.leak_v_s)
        taken_s = min(float(ctia.discharge_time(now, 0.0, ctia.LATE * now.swing_v)), PATIENCE_S)
        current_a = float(ctia.estimate_current(now)) * (taken_s < PATIENCE_S)
        log.append((current_a, elapsed_s + taken_s))
        bias_v += GATE.leak_v_s * (taken_s + GATE.pulse_s) - GATE.step_v
        elapsed_s += taken_s + GATE.pulse_s
    return min(measured for measured in log if measured[0] > 0)


print("         non-adaptive, adaptive (poor), adaptive (fine), limit set by the leak, in A")
for diode, poor_v, printed in zip(("si", "ingaas"), POOR_V, PRINTED, strict=True):
    fine_a, elapsed_s = tuned(diode, CTIA_PRESETS["ctia_si"].offset_v)
    poor, any_offset = pixel(diode, poor_v, GATE.leak_v_s), pixel(diode, OFFSETS * DacBias().step_v)
    # 0.8·S·C/(√1.8 − √0.2)/√(S·C/(g·r)) of a swing S, a conductance g at zero bias and a leak r
    leak_a_s = poor.diode.zero_bias_s * GATE.leak_v_s
    least_a = 0.8 * (poor.swing_v * poor.capacitance_f * leak_a_s) ** 0.5 / (1.8**0.5 - 0.2**0.5)
    mean_a, poor_a = (float(np.mean(ctia.estimate_current(at))) for at in (any_offset, poor))
    currents_a = mean_a, poor_a, fine_a, least_a
    print(f"{diode:6s}   {', '.join(f'{current:.3g}' for current in currents_a)}")
    print(f"printed: {printed}; programming takes {elapsed_s / 3600:.1f} h")
