"""
Crosstalk from one lit pixel
============================

One pixel of an otherwise dark array is lit. Its avalanches fire neighbors, which fire theirs. The
colors are mean counts, on a logarithmic scale. Theory: :doc:`/theory/avalanches`.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

from megalopta.sensor import changed, expose_rate, preset

sensor = changed(
    preset("ideal"),
    exposure_s=1e-3,
    crosstalk={"mean_fired_neighbors": 0.3, "diagonal": 0.4, "distance_two": 0.1},
)
light = np.zeros((100, 15, 15))
light[:, 7, 7] = 5e6
counts = expose_rate(light, sensor, seed=0, stream="one").counts.mean(axis=0)

plt.imshow(np.maximum(counts, 1e-2), norm=LogNorm(1e-2, counts.max()))
plt.grid(visible=False)
plt.colorbar(label="mean counts in 1 ms")
plt.xlabel("column")
plt.ylabel("row")
plt.show()
