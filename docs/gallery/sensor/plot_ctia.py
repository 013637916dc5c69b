"""
Low gain lets the bias rise
===========================

Discharge of a CTIA pixel in the dark, from a reverse bias of 1 mV. With an amplifier of 40 dB the
bias rises by 33 mV over the swing, and the dark current rises with it. Theory: :doc:`/theory/ctia`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import Photodiode
from megalopta.sensor.ctia.integration import Pixel, discharge, gain_from_db

diode = Photodiode(saturation_current_a=100e-12)
time_s = np.linspace(0, 0.1, 300)
for gain_db, dashes in ((40, "-"), (60, "--"), (80, "-.")):
    pixel = Pixel(
        diode, capacitance_f=100e-15, swing_v=3.3, gain=gain_from_db(gain_db), bias_v=1e-3
    )
    volts = 3.3 - discharge(pixel, 0.0, time_s)
    plt.plot(1e3 * time_s, volts, dashes, label=f"{gain_db} dB")
plt.xlabel("time (ms)")
plt.ylabel("output (V)")
plt.legend(title="amplifier gain")
plt.show()
