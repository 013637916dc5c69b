"""
A real array and its model
==========================

Half of the pixels of a real array of 12 × 4 SPADs (points), and the model fitted to the other half
(orange). Afterpulses need a table of their delays. More: :doc:`/results/real-arrays`.
"""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from megalopta import read_measurement
from megalopta.sensor import afterpulses_between, fit_crosstalk, fit_exponential, fit_table
from megalopta.sensor.calibrate.crosstalk import modelled

tables: Any = map(read_measurement, sorted(Path("../public_arrays").glob("*-1.csv")))
pulses, pairs, rates_hz = tables
plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
figure, (left, middle, right) = plt.subplots(1, 3)
fitted, tested = pairs.some(pairs.column < 5.5), pairs.some(pairs.column > 5.5)
distance = np.hypot(tested.down, tested.right)
left.semilogy(distance, tested.probability, ".", markersize=4)
left.plot(distance, modelled(fit_crosstalk(fitted), tested), "C1_", ms=14, mew=3)
left.set(xlabel="distance (pixels)", ylabel="probability", title="crosstalk")
middle.semilogx(np.sort(rates_hz[:, 6:].ravel()), np.linspace(4, 100, 24), ".")
middle.plot(np.sort(rates_hz[:, :6].ravel()), np.linspace(4, 100, 24), "C1")
middle.set(xlabel="rate (Hz)", ylabel="% of pixels", title="dark counts")
pulses = pulses.of(slice(None), 4e-6)
lags_ns, widths_s = 1e9 * pulses.edges_s[:-1], np.diff(pulses.edges_s)
right.loglog(lags_ns, pulses.of(slice(1, None, 2)).afterpulses.mean(axis=0), ".")
for fit, line in ((fit_exponential, "C1--"), (fit_table, "C1-")):
    model = afterpulses_between(fit(pulses.of(slice(0, None, 2))), pulses.edges_s) / widths_s
    right.plot(lags_ns, model, line, label=fit.__name__[4:])
right.legend(loc="upper right", handlelength=1.2, borderaxespad=0)
right.set(ylim=(100, 2e5), xlabel="delay (ns)", ylabel="rate (1/s)", title="afterpulses")
figure.suptitle("A real array fits its model; its afterpulses are not exponential")
plt.show()
