"""
The best bias is not the highest
================================

Count rates of light and of dark counts over the excess bias. Points are simulated, lines are in
closed form. Both rise; their ratio is largest at the dashed bias, at any light. Theory:
:doc:`/theory/device`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import best_excess_bias, changed, detection_rate, expose, preset

LAW = {"reference_v": 1.0, "onset_v": 0.2, "efficiency_scale_v": 0.5, "dark_efold_v": 0.3}
DARK = {"bulk_mean_hz_um2": 2.0, "bulk_sigma_hz_um2": 0.0, "hot_fraction": 0.0}
PLAIN = {"counter": {"kind": "digital"}, "dead_time": {"kind": "ideal", "dead_time_s": 0.0}}
at_reference = changed(preset("spadcam"), exposure_s=0.1, dark_counts=DARK, **PLAIN)
wall, bands_nm = np.full((1, 60, 60, 1), 1e-6), [(500, 600)]

volts, rates = np.linspace(0.3, 1.4, 12), []
for excess_v in volts:
    sensor = changed(at_reference, bias={**LAW, "excess_v": excess_v})
    lit, unlit = (
        expose(light, bands_nm, sensor, seed=0, stream="wall").counts.mean() / sensor.exposure_s
        for light in (wall, 0 * wall)
    )
    rates.append((lit - unlit, unlit))

efficiency = (1 - np.exp(-(volts - 0.2) / 0.5)) / (1 - np.exp(-0.8 / 0.5))
of_light = detection_rate(wall, bands_nm, changed(at_reference, bias={"dark_efold_v": 1e9})).mean()
plt.semilogy(volts, of_light * efficiency, label="light")
plt.semilogy(volts, 2e12 * sensor.active_area_m2 * np.exp((volts - 1) / 0.3), label="dark counts")
plt.gca().set_prop_cycle(None)
plt.semilogy(volts, rates, "o")
plt.axvline(best_excess_bias(sensor.bias), color="gray", ls="--", label="best bias")
plt.gca().set(xlabel="excess bias (V)", ylabel="count rate (Hz)")
plt.legend()
plt.show()
