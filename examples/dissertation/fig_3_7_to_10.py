"""
Figures 3.7 to 3.10: photocurrent and SNR against reverse bias
==============================================================

Each photocurrent is the difference of two 10–90 % estimates; LED1 and LED2 are our choice, as none
is printed. The SNR is 20·log10(photocurrent / dark current). The model allows a rise from 20 mV to
1 mV of 23.0 dB for an n = 1 diode and of 26.0 dB for a shunt. An error of the read bias would
explain the rest (dashed): one DAC code is 0.81 mV, and the offset could not be measured.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq

from megalopta.sensor import PHOTODIODES, DacBias
from megalopta.sensor.ctia.integration import Pixel, estimate_current, gain_from_db
from megalopta.sensor.ctia.photodiode import reverse_current

step_v = DacBias().step_v
bias_v = (np.unique(np.rint(np.geomspace(1, 1.2 / step_v, 40) - 0.5)) + 0.5) * step_v
figure, panels = plt.subplots(2, 2, figsize=(11, 8), layout="constrained")
DIODES = {"ingaas_quiet": ((150e-12, 600e-12), 40.0), "si": ((5e-12, 20e-12), 30.0)}
for (left, right), (name, (leds_a, stated_db)) in zip(panels, DIODES.items(), strict=True):
    diode = PHOTODIODES[name]

    def estimate_a(volts: np.ndarray, light_a: float, diode=diode) -> np.ndarray:  # type: ignore[no-untyped-def]
        """Estimated current of the fabricated pixel (10 pF, 130 dB)."""
        return estimate_current(Pixel(diode, 10e-12, 3.3, gain_from_db(130.0), volts), light_a)

    def missing(error_v: float, diode=diode, rise=10 ** (stated_db / 20)) -> float:  # type: ignore[no-untyped-def]
        far_a, near_a = (reverse_current(diode, read - error_v) for read in (20e-3, 1e-3))
        return float(far_a - rise * near_a)

    error_v = brentq(missing, 0.0, 1e-3)
    dark_a = estimate_a(bias_v, 0.0)
    left.loglog(1e3 * bias_v, dark_a, "k^-", label="dark")
    for color, light_a in enumerate(leds_a):
        photo_a = estimate_a(bias_v, light_a) - dark_a
        left.loglog(1e3 * bias_v, photo_a, "o-", color=f"C{color}", label=f"LED{color + 1}")
        right.semilogx(1e3 * bias_v, 20 * np.log10(photo_a / dark_a), "o-", color=f"C{color}")
        read_v = bias_v[bias_v > error_v]
        snr_db = 20 * np.log10(light_a / estimate_a(read_v - error_v, 0.0))
        right.semilogx(1e3 * read_v, snr_db, "--", color=f"C{color}")
    left.set(title=name, xlabel="reverse bias (mV)", ylabel="estimated current (A)")
    right.set(title=f"bias reads {1e3 * error_v:.2f} mV high (dashed)", ylabel="SNR (dB)")
    rise_db = -20 * np.diff(np.log10(estimate_a(np.array([20e-3, 1e-3]), 0.0)))[0]
    print(f"SNR, 20 to 1 mV, {name}: dissertation {stated_db:g} dB; here {rise_db:.1f} dB, exact,")
    print(f"    and {stated_db:g} dB if the bias reads {1e3 * error_v:.2f} mV high")
panels[0, 0].legend()
plt.show()
