"""
Cooling by thirty kelvin
========================

Dark counts double every few kelvin: simulated medians over the pixels of SPADCAM (points), and the
law (lines) with doubling every 8, 9 and 10 K. Theory: :doc:`/theory/device`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import changed, expose_rate, preset

celsius = np.arange(-20, 41, 10)
dark = np.zeros((20, 48, 48))
for doubling_k in (8, 9, 10):
    found = []
    for degrees in celsius:
        sensor = changed(
            preset("spadcam"),
            exposure_s=0.2,
            counter={"kind": "digital"},
            temperature={"celsius": degrees, "dcr_doubling_k": doubling_k},
        )
        counts = expose_rate(dark, sensor, seed=0, sequence="dark").counts
        found.append(np.median(counts.mean(axis=0)) / 0.2)
    at_reference = found[np.flatnonzero(celsius == 20)[0]]
    law = at_reference * 2 ** ((celsius - 20) / doubling_k)
    (line,) = plt.semilogy(celsius, law, label=f"twice in {doubling_k} K")
    plt.semilogy(celsius, found, "o", color=line.get_color())
plt.xlabel("temperature (°C)")
plt.ylabel("dark counts of a pixel, median (Hz)")
plt.legend()
plt.show()
