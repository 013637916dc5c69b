"""
Table 2.1: SPADs of the literature, as presets
==============================================

Printed values of each device, and measurements of its preset in 4 s in the dark and under 10⁵
photons per second on the active area. Limits are used as values, and efficiency is the peak value
at every wavelength. Fill factor and dead time are not in the table and remain those of the user.
"""

import numpy as np

from megalopta.sensor import changed, expose_rate, preset
from megalopta.sensor.spad.presets import TABLE_2_1

PHOTONS_HZ, EXPOSURE_S = 1e5, 4.0
print("preset                 V_ex   dark Hz/µm²: printed, ours   peak %: printed, ours   at nm")
for name, row in TABLE_2_1.items():
    sensor = changed(preset(name), exposure_s=EXPOSURE_S)
    rates_hz = np.zeros((2, 40, 40))
    rates_hz[1] = PHOTONS_HZ * sensor.efficiency.values[0]
    counts = expose_rate(rates_hz, sensor, seed=0, stream=f"table {name}").counts
    dark_hz, bright_hz = counts.mean((1, 2), dtype=np.float64) / EXPOSURE_S
    print(
        f"{name:22s} {row['excess_v']:4g} {row['density_hz_um2']:18g}, "
        f"{dark_hz / row['area_um2']:<9.3g} {100 * row['peak']:16.0f}, "
        f"{100 * (bright_hz - dark_hz) / PHOTONS_HZ:<4.1f} {row['peak_nm']:12g}"
    )
