"""
Figures 2.9 to 2.12: a row of SPADCAM over its bias
===================================================

A simulated row of 16 pixels is measured like the real one: 500 frames of 0.1 s at each bias, in the
dark and under 396 photons/µm²/s of 450 nm. Curves of efficiency end where a counter saturates. Over
many devices the preset has the printed statistics; a single row differs.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import best_excess_bias, changed, expose_rate, preset
from megalopta.sensor.spad.device import draw_fixed_pattern

SPADCAM, AT_BREAKDOWN_V, PIXELS = preset("spadcam"), 12.40, 16
photons_hz, area_um2 = 396.0 * 360.0, 360.0
anode_v = np.arange(13.40, 13.801, 0.02)
dark_hz, efficiency = np.empty((2, anode_v.size, PIXELS))
for place, volts in enumerate(anode_v):
    sensor = changed(SPADCAM, bias={"excess_v": float(volts) - AT_BREAKDOWN_V})
    factor = draw_fixed_pattern(sensor, (1, PIXELS)).efficiency_factor
    seen = factor * sensor.efficiency(np.array(450.0))
    light_hz = np.broadcast_to(photons_hz * seen, (500, 1, PIXELS))
    dark = expose_rate(0 * light_hz, sensor, seed=0, stream=f"dark, {volts:.2f} V")
    bright = expose_rate(light_hz, sensor, seed=0, stream=f"light, {volts:.2f} V")
    dark_hz[place] = dark.counts.mean((0, 1)) / sensor.exposure_s
    detected_hz = bright.counts.mean((0, 1)) / sensor.exposure_s - dark_hz[place]
    is_full = bright.saturated.any((0, 1))
    efficiency[place] = np.where(is_full, np.nan, detected_hz / photons_hz)

figure, panels = plt.subplots(2, 2, figsize=(10, 8), layout="constrained")
density = np.where(dark_hz > 0, dark_hz, np.nan) / area_um2
panels[0, 0].semilogy(anode_v, density, "C0", alpha=0.5)
panels[0, 0].set(title="2.9", xlabel="anode voltage (V)", ylabel="dark counts (Hz/µm²)")
for volts in (13.48, 13.54, 13.58, 13.64, 13.68):
    rates = np.sort(np.nan_to_num(density[np.abs(anode_v - volts).argmin()]))
    panels[0, 1].step(rates, np.arange(1, 17) / 16, where="post", label=f"{volts} V")
panels[0, 1].set(title="2.10", xlabel="dark counts (Hz/µm²)", ylabel="share of the pixels")
panels[0, 1].legend()
panels[1, 0].plot(anode_v, 100 * efficiency, "C0", alpha=0.5)
panels[1, 0].set(title="2.11", xlabel="anode voltage (V)", ylabel="detection efficiency (%)")
sheet = np.abs(anode_v - 13.58).argmin()
chosen = np.argsort(dark_hz[sheet])[[0, 5, 10, 13]]
panels[1, 1].plot(anode_v, 10 * np.log10(1e6 * efficiency / dark_hz)[:, chosen])
panels[1, 1].axvline(best_excess_bias(SPADCAM.bias) + AT_BREAKDOWN_V, color="gray", linestyle="--")
panels[1, 1].set(title="2.12: 10⁶ photons/s", xlabel="anode voltage (V)", ylabel="SNR (dB)")
print(f"mean at 13.58 V: {density[sheet].mean():.2f} Hz/µm²; printed: 1.77 Hz/µm²")
plt.show()
