"""
Figure 3.6: dark current against reverse bias, non-adaptive pixel
=================================================================

10–90 % estimates at DAC codes with the presets of the diodes, which lack the generation and
tunneling that make real currents rise faster. Dotted: the lowest measured currents. That of Si
needs a bias within 0.08 mV of zero, as one offset in ten gives; ours is that at half a code.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import PHOTODIODES, DacBias
from megalopta.sensor.ctia.integration import Pixel, estimate_current, gain_from_db

step_v = DacBias().step_v
codes = np.unique(np.rint(np.geomspace(1, 1.0 / step_v, 40) - 0.5))
bias_v = (codes + 0.5) * step_v


def current_a(diode: str, volts: float | np.ndarray) -> np.ndarray:
    """Estimated dark current of the fabricated pixel of §3.2.4 (10 pF, 130 dB)."""
    pixel = Pixel(PHOTODIODES[diode], 10e-12, 3.3, gain_from_db(130.0), volts)
    return np.asarray(estimate_current(pixel))


for color, (diode, lowest_a) in enumerate({"ingaas": 700e-12, "si": 10.4e-15}.items()):
    plt.loglog(1e3 * bias_v, current_a(diode, bias_v), "o-", color=f"C{color}", label=diode)
    plt.axhline(lowest_a, color=f"C{color}", linestyle=":")
    decades = np.log10(current_a(diode, 20e-3) / current_a(diode, step_v / 2))
    print(f"{diode}: fall from 20 to 0.4 mV {decades:.1f} decades; printed: 1 to 2")
    print(f"{diode}: lowest {current_a(diode, bias_v[0]):.3g} A; printed: {lowest_a:g} A")
plt.xlabel("reverse bias (mV)")
plt.ylabel("dark current (A)")
plt.legend()
plt.show()
