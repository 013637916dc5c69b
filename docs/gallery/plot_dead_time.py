"""
Dead time bends the response
============================

Counts over arrivals for three kinds of pixel. Points are simulated, lines are exact. Past its peak,
a paralyzable pixel counts less in brighter light. Theory: :doc:`/theory/dead-time`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import DeadTime, changed, expose_rate, preset
from megalopta.sensor.effects.dead_time import moments

EXPOSURE_S, DEAD_TIME_S = 1e-4, 1e-6
rates_hz = np.geomspace(1e4, 1e7, 13)
fine_hz = np.geomspace(1e4, 1e7, 200)

kinds = {"ideal": "o", "nonparalyzable": "s", "paralyzable": "^"}
for kind, marker in kinds.items():
    effect = DeadTime(kind=kind, dead_time_s=0.0 if kind == "ideal" else DEAD_TIME_S)
    sensor = changed(preset("ideal"), exposure_s=EXPOSURE_S, dead_time=effect.model_dump())
    light = np.broadcast_to(rates_hz[:, None, None], (rates_hz.size, 40, 40))
    counts = expose_rate(light, sensor, seed=0, stream=kind).counts.mean(axis=(1, 2))
    (line,) = plt.loglog(fine_hz, moments(fine_hz, EXPOSURE_S, effect)[0], label=kind)
    plt.loglog(rates_hz, counts, marker, color=line.get_color())
plt.xlabel("arrivals (Hz)")
plt.ylabel("mean counts in 100 µs (dead time 1 µs)")
plt.legend()
plt.show()
