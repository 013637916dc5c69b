"""
Table 3.1: dark current suppression of the CTIA pixel
=====================================================

Non-adaptive: mean over an offset anywhere between two DAC codes. Poor: the state at 15 mV (Si,
which defines the preset) and 17.5 mV (InGaAs). Fine: the end of the programming loop, in pulses of
500 µV with leakage of 1.5 µV/s. Last column: the least current with that leak, which is
proportional to the root of the conductance at zero bias.
"""

import numpy as np

from megalopta.sensor.ctia.bias import DacBias, FloatingGateBias, calibrate_gate, leak_floor
from megalopta.sensor.ctia.integration import Pixel, estimate_current, gain_from_db
from megalopta.sensor.ctia.model import PHOTODIODES, TYPICAL_OFFSET_V


def pixel(diode: str, bias_v: float | np.ndarray, drift_v_s: float = 0.0) -> Pixel:
    """The fabricated pixel of §3.2.4 (10 pF, 130 dB)."""
    return Pixel(PHOTODIODES[diode], 10e-12, 3.3, gain_from_db(130.0), bias_v, drift_v_s)


leak_v_s = FloatingGateBias().leak_v_s
offsets_v = (np.arange(200) + 0.5) / 200 * DacBias().step_v
PRINTED_A = {
    "si": (15e-3, "10.4 fA, 1.6 pA, 33.8 fA"),
    "ingaas": (17.5e-3, "700 pA, 5.8 nA, 2.25 pA"),
}
print("         non-adaptive, adaptive (poor), adaptive (fine), limit set by the leak, in A")
for diode, (poor_v, printed) in PRINTED_A.items():
    log = calibrate_gate(FloatingGateBias(), pixel(diode, TYPICAL_OFFSET_V))
    fine = min(log, key=lambda turn: turn.current_a or np.inf)
    currents_a = (
        float(estimate_current(pixel(diode, offsets_v)).mean()),
        float(estimate_current(pixel(diode, poor_v, leak_v_s))),
        fine.current_a,
        leak_floor(pixel(diode, 0.0, leak_v_s)),
    )
    print(f"{diode:6s}   {', '.join(f'{current:.3g}' for current in currents_a)}")
    print(f"printed: {printed}; programming takes {fine.elapsed_s / 3600:.1f} h")
