"""
Dark counts: a quiet bulk, and hot pixels
=========================================

Dark count rates of one simulated SPADCAM, constant from frame to frame: 32 × 32 of its pixels, and
the histogram of all. Theory: :doc:`/theory/device`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import changed, dark_count_density, preset

sensor = changed(preset("spadcam"), device_seed=7)
density_hz_um2 = dark_count_density(sensor.dark_counts, (128, 128), sensor.device_seed)
rates_hz = density_hz_um2 * sensor.active_area_m2 * 1e12

figure, (image, histogram) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
shown = image.imshow(rates_hz[:32, :32])
figure.colorbar(shown, ax=image, label="dark counts (Hz)")
image.set(xlabel="column", ylabel="row")
image.grid(visible=False)
histogram.hist(rates_hz.ravel(), np.geomspace(20, 4000, 60))
histogram.set_xscale("log")
histogram.set_xlabel("dark counts (Hz)")
histogram.set_ylabel("pixels")
plt.show()
