"""
Figures 2.9 to 2.12: a row of SPADCAM over its bias
===================================================

500 frames of 0.1 s at each bias, in the dark and under 396 photons/µm²/s of 450 nm. Printed: means
over 1000 rows ± σ of a row of 16 pixels. The preset was matched to the stated dark counts.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import best_excess_bias, changed, expose_rate, preset
from megalopta.sensor.spad.device import draw_fixed_pattern

SPADCAM, ANODE_V, AT_BREAKDOWN_V = preset("spadcam"), np.arange(13.40, 13.801, 0.02), 12.40
area_um2, photons_hz, blue_nm = 360.0, 396.0 * 360.0, np.array(450.0)
dark_hz, efficiency = np.empty((2, ANODE_V.size, 16))
for place, volts in enumerate(ANODE_V):
    sensor = changed(SPADCAM, bias={"excess_v": float(volts) - AT_BREAKDOWN_V})
    seen = draw_fixed_pattern(sensor, (1, 16)).efficiency_factor * sensor.efficiency(blue_nm)
    light_hz = np.repeat([0.0, photons_hz], 500)[:, np.newaxis, np.newaxis] * seen
    frames = expose_rate(light_hz, sensor, seed=0, stream=f"{volts:.2f} V")
    dark_hz[place], lit_hz = frames.counts.reshape(2, 500, 16).mean(axis=1) / sensor.exposure_s
    lit_hz[frames.saturated.any(axis=(0, 1))] = np.nan
    efficiency[place] = (lit_hz - dark_hz[place]) / photons_hz
density = dark_hz / area_um2
curves = density, 100 * efficiency, 10 * np.log10(1e6 * efficiency / dark_hz)
titles = "2.9: dark counts (Hz/µm²)", "2.11: detection efficiency (%)", "2.12: SNR (dB)"
figure, panels = plt.subplots(2, 2, figsize=(10, 8), layout="constrained")
for axes, title, values in zip(panels.flat[:3], titles, curves, strict=True):
    axes.plot(ANODE_V, values, "C0", alpha=0.5)
    axes.set(title=title, xlabel="anode voltage (V)", yscale="log" if "2.9" in title else "linear")
for volts in (13.48, 13.54, 13.58, 13.64, 13.68):
    panels[1, 1].ecdf(density[np.abs(ANODE_V - volts).argmin()], label=f"{volts} V")
panels[1, 1].set(title="2.10: share of the pixels", xlabel="dark counts (Hz/µm²)")
panels[1, 1].legend()
high = changed(SPADCAM, bias={"excess_v": 13.68 - AT_BREAKDOWN_V})
rows, high_hz = (draw_fixed_pattern(at, (1000, 16)).dark_counts_hz for at in (SPADCAM, high))
for name, stated, values in (
    ("mean at 13.58 V, Hz/µm²", 1.77, rows.mean(axis=1) / area_um2),
    ("median, Hz/µm²", 0.93, np.median(rows, axis=1) / area_um2),
    ("σ, Hz/µm²", 1.77, rows.std(axis=1, ddof=1) / area_um2),
    ("pixels below 1.5 Hz/µm²", 11, (rows < 1.5 * area_um2).sum(axis=1)),
    ("full at 13.68 V in 0.1 s", "nearly 16", (0.1 * high_hz > 320).sum(axis=1)),
    ("full at 13.68 V in 1 s", "nearly 16", (high_hz > 320).sum(axis=1)),
):
    print(f"{name}: dissertation {stated}; here {values.mean():.2f} ± {values.std():.2f}")
print(f"peak: dissertation < 1 %; here {100 * np.nanmax(efficiency):.2f} %")
print(f"best SNR: dissertation below it; here {best_excess_bias(SPADCAM.bias) + 12.4:.2f} V")
plt.show()
