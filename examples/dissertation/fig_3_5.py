"""
Figure 3.5: CTIA pixel discharging in the dark, Si photodiode
=============================================================

The fabricated pixel (10 pF, 130 dB) has the preset of the SFH229FA and DAC codes half a code off
zero. Beyond zero the diode is in forward bias and the pixel does not discharge. The dissertation
states no number for this figure but says that the slope falls with the bias.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import PHOTODIODES, DacBias
from megalopta.sensor.ctia.integration import Pixel, discharge, discharge_time, gain_from_db

SWING_V = 3.3
for code in (24.5, 12.5, 6.5, 3.5, 1.5, 0.5, -0.5):
    bias_v = code * DacBias().step_v
    pixel = Pixel(PHOTODIODES["si"], 10e-12, SWING_V, gain_from_db(130.0), bias_v)
    end_s = float(discharge_time(pixel, 0.0, SWING_V))
    time_s = np.linspace(0, min(end_s, 300.0), 301)
    print(f"discharge at {1e3 * bias_v:.1f} mV: dissertation not stated; here {end_s:.3g} s, exact")
    plt.plot(time_s, SWING_V - discharge(pixel, 0.0, time_s), label=f"{1e3 * bias_v:.1f} mV")
plt.xlabel("time (s)")
plt.ylabel("output (V)")
plt.legend(title="reverse bias")
plt.show()
