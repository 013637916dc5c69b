"""
Dead time bends the response
============================

Counts in 100 µs over arrivals, for pixels with a dead time of 1 µs. Points are simulated, lines are
exact. Past its peak, a paralyzable pixel counts less in brighter light: one count belongs to two
levels of light. Theory: :doc:`/theory/dead-time`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import DeadTime, changed, expose_rate, preset
from megalopta.sensor.effects.dead_time import moments

EXPOSURE_S, DEAD_TIME_S = 1e-4, 1e-6
rates_hz, fine_hz = np.geomspace(1e4, 1e7, 13), np.geomspace(1e4, 1e7, 200)
light = np.broadcast_to(rates_hz[:, None, None], (13, 40, 40))
kinds = {"ideal": "o", "nonparalyzable": "s", "paralyzable": "^"}

plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
figure, axes = plt.subplots()
for kind, marker in kinds.items():
    effect = DeadTime(kind=kind, dead_time_s=0.0 if kind == "ideal" else DEAD_TIME_S)
    sensor = changed(preset("ideal"), exposure_s=EXPOSURE_S, dead_time=effect.model_dump())
    counts = expose_rate(light, sensor, seed=0, stream=kind).counts.mean(axis=(1, 2))
    (line,) = axes.loglog(fine_hz, moments(fine_hz, EXPOSURE_S, effect)[0])
    axes.loglog(rates_hz, counts, marker, color=line.get_color(), clip_on=False)
    axes.text(1.15e7, counts[-1], kind, color=line.get_color(), va="center", weight="bold")
axes.set(xlabel="arrivals (Hz)", ylabel="counts in 100 µs", xlim=(1e4, 1e7), ylim=(0.7, 1500))
figure.suptitle("With a dead time of 1 µs, more light can mean fewer counts")
plt.show()
