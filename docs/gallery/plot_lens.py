"""
From radiance to detections
===========================

Detections per second of a pixel of 30 µm that sees a gray wall, over the f-number: computed by the
sensor (points), and π·L/(4N² + 1) times area, efficiency and λ/hc (line). Theory:
:doc:`/theory/light`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.constants import c, h

from megalopta.sensor import changed, detection_rate, preset

RADIANCE, BAND_NM = 1e-9, (540, 560)  # W·m⁻²·sr⁻¹·nm⁻¹
numbers = np.array([1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0])
ideal = changed(preset("ideal"), pitch_m=30e-6, fill_factor=0.4)
wall = np.full((1, 8, 8, 1), RADIANCE)

found = []
for number in numbers:
    sensor = changed(ideal, lens={"f_number": number, "transmission": 0.9})
    found.append(detection_rate(wall, [BAND_NM], sensor).mean())

fine = np.linspace(0.9, 9, 200)
photons = RADIANCE * (BAND_NM[1] ** 2 - BAND_NM[0] ** 2) / 2 * 1e-9 / (h * c)  # m⁻²·s⁻¹·sr⁻¹
share = 30e-6**2 * 0.4 * ideal.efficiency.values[0]
plt.loglog(fine, 0.9 * np.pi * photons / (4 * fine**2 + 1) * share, label="in closed form")
plt.loglog(numbers, found, "o", label="computed")
plt.xlabel("f-number")
plt.ylabel("detection rate (Hz)")
plt.xticks(numbers, [f"{number:g}" for number in numbers])
plt.minorticks_off()
plt.legend()
plt.show()
