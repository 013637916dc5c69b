"""
Afterpulses add counts, and more noise than counts
==================================================

With a mean of p carriers trapped by an avalanche, long exposures have 1/(1 − p) times the counts
and 1/(1 − p)³ times the variance. Points are simulated, lines are exact. Theory:
:doc:`/theory/avalanches`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import changed, expose_rate, preset

PRIMARIES = 200
traps = np.linspace(0, 0.5, 6)
ideal = changed(preset("ideal"), exposure_s=1e-3)
light = np.full((1, 100, 100), PRIMARIES / ideal.exposure_s)

mean, variance = [], []
for p in traps:
    sensor = changed(ideal, afterpulsing={"mean_carriers": p, "delay_s": 50e-9})
    counts = expose_rate(light, sensor, seed=0, stream=f"{p:g}").counts
    mean.append(counts.mean() / PRIMARIES)
    variance.append(counts.var() / PRIMARIES)

fine = np.linspace(0, 0.5, 100)
for values, power, name in ((mean, 1, "mean"), (variance, 3, "variance")):
    (points,) = plt.semilogy(traps, values, "o", label=name)
    plt.semilogy(fine, (1 - fine) ** -power, color=points.get_color())
plt.xlabel("mean carriers trapped by an avalanche, p")
plt.ylabel("ratio to the primary counts")
plt.yticks([1, 2, 4, 8], ["1", "2", "4", "8"])
plt.minorticks_off()
plt.legend()
plt.show()
