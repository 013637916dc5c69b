"""
Five bits: full, or around the clock
====================================

Mean readings of a counter of 31 events that stays full or starts again at zero, over the events
that arrive: simulated (points), sums over Poisson's law (lines). Theory: :doc:`/theory/counters`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import poisson

from megalopta.sensor import changed, expose_rate, preset

CAPACITY = 31
means = np.linspace(1, 90, 24)
fine = np.linspace(0.5, 90, 200)
n = np.arange(250)
laws = {"saturate": np.minimum(n, CAPACITY), "wrap": n % (CAPACITY + 1)}
for overflow, read in laws.items():
    sensor = changed(
        preset("ideal"), exposure_s=1e-3, counter={"capacity": CAPACITY, "overflow": overflow}
    )
    light = np.broadcast_to(1e3 * means[:, None, None], (means.size, 40, 40))
    counts = expose_rate(light, sensor, seed=0, sequence=overflow).counts.mean(axis=(1, 2))
    (line,) = plt.plot(fine, poisson.pmf(n, fine[:, None]) @ read, label=overflow)
    plt.plot(means, counts, "o", color=line.get_color())
plt.xlabel("mean events of an exposure")
plt.ylabel("mean reading")
plt.legend()
plt.show()
