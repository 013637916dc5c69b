"""
Table 2.1: SPADs of the literature, as presets
==============================================

Measurements of each device's preset in 4 s in the dark and under 10⁵ photons per second on the
active area, ± standard error over 1600 pixels. Limits are used as values, and efficiency is the
peak value at every wavelength. Fill factor and dead time are not in the table and stay yours.
"""

import numpy as np

from megalopta.sensor import changed, expose_rate, preset
from megalopta.sensor.spad.presets import TABLE_2_1

PHOTONS_HZ, EXPOSURE_S = 1e5, 4.0
for name, row in TABLE_2_1.items():
    sensor = changed(preset(name), exposure_s=EXPOSURE_S)
    rates_hz = np.zeros((2, 40, 40))
    rates_hz[1] = PHOTONS_HZ * sensor.efficiency.values[0]
    counts = expose_rate(rates_hz, sensor, seed=0, stream=f"table {name}").counts
    dark, lit = counts.reshape(2, -1) / EXPOSURE_S
    for quantity, stated, of_pixels in (
        ("dark counts, Hz/µm²", row["density_hz_um2"], dark / row["area_um2"]),
        (f"peak at {row['peak_nm']:g} nm, %", 100 * row["peak"], 100 * (lit - dark) / PHOTONS_HZ),
    ):
        error = of_pixels.std() / of_pixels.size**0.5
        measured = f"{of_pixels.mean():.4g} ± {error:.1g}"
        print(f"{name}, {quantity}: dissertation {stated:.3g}; here {measured}")
