"""
Efficiency of a band
====================

SPADCAM's photon detection probability (line), and its mean over the photons of each rendered band
of 100 nm (bars). Crosses are the share that is counted of 40 000 photons on the active area,
without dark counts. Theory: :doc:`/theory/light`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import band_means, changed, expose_rate, preset

sensor = preset("spadcam")
bands_nm = [(start, start + 100) for start in range(400, 900, 100)]
of_bands = band_means([sensor.efficiency], bands_nm)
ideal = changed(preset("ideal"), exposure_s=1e-3)
light = 4e7 * np.broadcast_to(of_bands[:, None, None], (len(bands_nm), 60, 60))
counted = expose_rate(light, ideal, seed=0, stream="bands").counts.mean(axis=(1, 2)) / 4e4

plt.plot(sensor.efficiency.wavelengths_nm, sensor.efficiency.values, label="SPADCAM")
middle = [np.mean(band) for band in bands_nm]
plt.errorbar(middle, of_bands, xerr=50, fmt="o", label="mean of a band")
plt.plot(middle, counted, "kx", zorder=3, label="simulated")
plt.xlim(380, 920)
plt.xlabel("wavelength (nm)")
plt.ylabel("photon detection probability")
plt.legend()
plt.show()
