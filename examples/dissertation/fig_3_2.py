"""
Figure 3.2: CTIA pixel discharging from an input offset of 1 mV
===============================================================

As in the dissertation, the saturation current is 100 pA, the capacitance 100 fF, and there is no
light. With less gain the input moves more over the swing, and the dark current grows more.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import Photodiode
from megalopta.sensor.ctia.integration import Pixel, discharge, discharge_time, gain_from_db
from megalopta.sensor.ctia.photodiode import reverse_current

SWING_V = 3.3
diode = Photodiode(saturation_current_a=100e-12)
for gain_db in range(40, 91, 10):
    pixel = Pixel(diode, 100e-15, SWING_V, gain_from_db(float(gain_db)), 1e-3)
    end_s = float(discharge_time(pixel, 0.0, SWING_V))
    time_s = np.linspace(0, min(end_s, 0.09), 181)
    plt.plot(1e3 * time_s, SWING_V - discharge(pixel, 0.0, time_s), label=f"{gain_db} dB")
    print(f"{gain_db} dB: here {1e3 * end_s:.1f} ms from reset to the lower rail, exact")
for decibels, stated in ((40.0, "33 mV"), (100.0, "33 µV")):
    moved_uv = 1e6 * SWING_V / gain_from_db(decibels)
    print(f"input moves, {decibels:g} dB: dissertation {stated}; here {moved_uv:.0f} µV, exact")
for sign, kind in ((1, "reverse"), (-1, "forward")):
    far_a, near_a = (reverse_current(diode, sign * volts) for volts in (10e-3, 1e-3))
    print(
        f"current at 10 mV over that at 1 mV: dissertation > 10; here {far_a / near_a:.1f}, {kind}"
    )
plt.xlabel("time (ms)")
plt.ylabel("output (V)")
plt.legend(title="open-loop gain")
plt.show()
