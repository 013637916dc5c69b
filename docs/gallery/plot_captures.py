"""
Real arrays and the model
=========================

Crosstalk, dark counts and afterpulses of a real array of 12 × 4 pixels. The model (lines) is fitted
to half of the pixels and drawn with the other half. Explanation: :doc:`/results/real-arrays`.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from megalopta import read_measurement
from megalopta.sensor import (
    Autocorrelation,
    PairCrosstalk,
    afterpulses_between,
    fit_crosstalk,
    fit_exponential,
    fit_table,
)
from megalopta.sensor.calibrate.crosstalk import modelled

arrays = Path("../public_arrays")  # from docs/gallery
pairs, rates, pulses = (
    read_measurement(arrays / f"{each}-1.csv")
    for each in ("crosstalk", "dark-counts", "autocorrelation")
)
assert isinstance(pairs, PairCrosstalk)
assert isinstance(rates, np.ndarray)
assert isinstance(pulses, Autocorrelation)
figure, (left, middle, right) = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
fitted, tested = pairs.some(pairs.column < 5.5), pairs.some(pairs.column > 5.5)
crosstalk = modelled(fit_crosstalk(fitted), tested)
distance = np.hypot(tested.down, tested.right)
left.semilogy(distance, tested.probability, ".", markersize=4)
left.plot(distance[crosstalk > 0], crosstalk[crosstalk > 0], "_", markersize=16, markeredgewidth=3)
left.set(xlabel="distance (pixels)", ylabel="probability of crosstalk")
middle.semilogx(np.sort(rates[:, 6:].ravel()), np.arange(1, 25) / 24, ".")
middle.plot(np.sort(rates[:, :6].ravel()), np.arange(1, 25) / 24)
middle.set(xlabel="dark counts (Hz)", ylabel="share of pixels")
pulses = pulses.of(slice(None), 4e-6)
lags, widths = pulses.edges_s[:-1], np.diff(pulses.edges_s)
right.loglog(1e9 * lags, pulses.of(slice(1, None, 2)).afterpulses.mean(axis=0), ".", label="seen")
for fit in (fit_exponential, fit_table):
    model = fit(pulses.of(slice(0, None, 2)))
    density = afterpulses_between(model, pulses.edges_s) / widths
    right.plot(1e9 * lags, density, label=fit.__name__.removeprefix("fit_"))
right.set(ylim=(100, 2e5), xlabel="time since an event (ns)", ylabel="afterpulses (1/s)")
right.legend()
plt.show()
