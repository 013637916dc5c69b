"""
Least error of a sensor over its exposure
=========================================

Standard error of the flow of blocks of 24 px between two frames, while the camera turns by 300° per
second. At first longer exposures help, by their photons; then motion blurs, and in twilight the
counter of 8 bits saturates. The sensor is a SPAD of Table 2.1 on a pitch of 20 µm, behind f/1.4. No
photons are drawn. How-to: :doc:`/how-to/design`.
"""

import matplotlib.pyplot as plt

import megalopta
from megalopta.sensor import changed, preset

array = changed(preset("richardson-130nm"), pitch_m=20e-6, counter={"capacity": 255})
levels = ("twilight", "full_moon", "quarter_moon", "starlight")
found = megalopta.design(array, error="0.1px", light_levels=levels, yaw_deg_s=300)

for level, dash in zip(levels, ("-", "--", "-.", ":"), strict=True):
    own = [each for each in found.points if each.level == level]
    times_ms = [1e3 * each.exposure_s for each in own]
    plt.loglog(times_ms, [each.error_px for each in own], dash, label=level.replace("_", " "))
plt.axhline(0.1, color="k", linewidth=0.8)
plt.xlabel("exposure (ms)")
plt.ylabel("standard error of flow (px)")
plt.ylim(0.01, 10)
plt.legend()
plt.show()
