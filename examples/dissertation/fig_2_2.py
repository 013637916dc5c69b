"""
Figure 2.2: count rate over photon rate with dead time
======================================================

Stationary means (Eq. 2.5 and 2.6) for four dead times τ. The count rate saturates at 1/τ if
non-paralyzable; if paralyzable it peaks at 1/(e·τ), at one photon per dead time.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import DeadTime
from megalopta.sensor.effects.dead_time import moments

photons_hz = np.geomspace(1e3, 1e10, 281)
plt.loglog(photons_hz, photons_hz, "k", label="ideal")
for place, dead_time_s in enumerate((1e-9, 1e-8, 1e-7, 1e-6)):
    for kind, dash in (("nonparalyzable", "-"), ("paralyzable", "--")):
        dead_time = DeadTime(kind=kind, dead_time_s=dead_time_s, start="stationary")
        counts_hz, _ = moments(photons_hz, 1.0, dead_time)
        label = f"τ = {1e9 * dead_time_s:g} ns" if dash == "-" else None
        plt.loglog(photons_hz, counts_hz, dash, color=f"C{place}", label=label)
        if dead_time_s == 1e-7:
            decibels = 20 * np.log10(counts_hz.max() / 100)
            name = f"dynamic range from 100 Hz, {kind}"
            print(f"{name}: dissertation < 100 dB; here {decibels:.1f} dB, exact")
low_hz = np.linspace(0, 1e7, 1001)  # §4.2: linear up to 10⁷ photons/s at a rate of 20 MHz
r2 = np.corrcoef(low_hz, low_hz / (1 + low_hz * 50e-9))[0, 1] ** 2
print(f"R² up to 10⁷ photons/s, τ = 50 ns: dissertation > 0.999; here {r2:.3f}, exact")
plt.plot([], [], "k--", label="paralyzable")
plt.xlabel("photon rate (1/s)")
plt.ylabel("count rate (1/s)")
plt.ylim(1e3, 3e9)
plt.legend(ncols=2)
plt.show()
