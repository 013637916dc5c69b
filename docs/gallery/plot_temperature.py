"""
Cooling lowers dark counts
==========================

Dark counts of SPADCAM over temperature, which double every 8, 9 or 10 K. Points are simulated
medians over the pixels, lines are exponentials. Theory: :doc:`/theory/device`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import changed, expose_rate, preset

celsius = np.arange(-20, 41, 10)
dark = np.zeros((20, 48, 48))
for doubling_k, marker in ((8, "o"), (9, "s"), (10, "^")):
    found = []
    for degrees in celsius:
        sensor = changed(
            preset("spadcam"),
            exposure_s=0.2,
            counter={"kind": "digital"},
            temperature={"celsius": degrees, "dcr_doubling_k": doubling_k},
        )
        counts = expose_rate(dark, sensor, seed=0, stream="dark").counts
        found.append(np.median(counts.mean(axis=0)) / 0.2)
    at_reference = found[np.flatnonzero(celsius == 20)[0]]
    doubled = at_reference * 2 ** ((celsius - 20) / doubling_k)
    (line,) = plt.semilogy(celsius, doubled, label=f"doubles every {doubling_k} K")
    plt.semilogy(celsius, found, marker, color=line.get_color())
plt.xlabel("temperature (°C)")
plt.ylabel("median dark counts (Hz)")
plt.legend()
plt.show()
