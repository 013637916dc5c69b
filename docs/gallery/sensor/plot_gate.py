"""
A gate, and the jitter of its edges
===================================

Times of events modulo the period of a gate that is open for 20 of 100 ns. Without jitter the edges
are sharp; a normal distribution of 4 ns smears them. Steps are simulated, dotted lines are exact.
Theory: :doc:`/theory/dead-time`, :doc:`/theory/avalanches`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.special import ndtr

from megalopta.sensor import changed, expose_events, preset

PERIOD_S, WIDTH_S, PHASE_S = 100e-9, 20e-9, 40e-9
light = np.full((1, 64, 64), 2e6)
fine = np.linspace(0, 100, 400)
for sigma_s in (0.0, 4e-9):
    sensor = changed(
        preset("ideal"),
        exposure_s=1e-4,
        gate={"period_s": PERIOD_S, "width_s": WIDTH_S, "phase_s": PHASE_S},
        jitter={"sigma_s": sigma_s},
    )
    times = expose_events(light, sensor, seed=0, stream="gated").time_s
    name = f"jitter {1e9 * sigma_s:g} ns"
    plt.hist(
        1e9 * (times % PERIOD_S), 100, range=(0, 100), density=True, histtype="step", label=name
    )
    spread = max(1e9 * sigma_s, 1e-9)
    plt.plot(fine, (ndtr((fine - 40) / spread) - ndtr((fine - 60) / spread)) / 20, "k:", lw=1)
plt.xlabel("time since the gate's period began (ns)")
plt.ylabel("share of events (1/ns)")
plt.legend()
plt.show()
