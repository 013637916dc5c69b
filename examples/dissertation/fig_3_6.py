"""
Figure 3.6: dark current against reverse bias, non-adaptive pixel
=================================================================

10–90 % estimates at DAC codes with the presets of the diodes, which lack the generation and
tunneling that make real currents rise faster. Dotted: the lowest measured currents. The offset is
anywhere between two codes, which gives the printed range of the fall.
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
    falls = np.log10(current_a(diode, 20e-3) / current_a(diode, np.linspace(0, step_v, 401)[1:]))
    middle, low, high = np.percentile(falls, (50, 2.5, 97.5))
    print(f"fall from 20 mV, {diode}: dissertation 1 to 2 decades;", end=" ")
    print(f"here {middle:.1f}, 95 % of offsets {low:.1f} to {high:.1f}")
plt.xlabel("reverse bias (mV)")
plt.ylabel("dark current (A)")
plt.legend()
plt.show()
