"""
Figures 2.18 and 2.19: peak responses to an edge over its velocity
==================================================================

Mean and σ of the largest response of one detector while an edge crosses, over 16 crossings of ten
detectors in each of 16 rows. The SNR is 20·log10(mean/σ), averaged over the speeds but 0, ± σ
between rows; the dissertation does not define its own. Theory: the mean response to a sinusoid of
half a cycle along the row, scaled to the same height.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.camera import motion_bench as bench
from megalopta.flow import ndm_mean, nds_mean

velocity = np.array([bench.pixels_per_frame(speed) for speed in bench.SPEEDS_MM_S])
fine, phase = np.linspace(0, velocity[-1], 201), np.pi / bench.PIXELS
figure, panels = plt.subplots(1, 2, figsize=(12, 4.5), layout="constrained")
methods = {"NDM": (ndm_mean, 12.6), "NDS": (nds_mean, 15.7)}
for axes, (method, (mean_response, stated_db)) in zip(panels, methods.items(), strict=True):
    for shift, (name, sensor) in zip((-0.1, 0.1), bench.SENSORS.items(), strict=True):
        measured = [bench.peaks(speed, sensor)[method] for speed in bench.SPEEDS_MM_S]
        snr_db = np.mean([peak.snr_db for peak in measured[1:]])
        means, sigmas = zip(*((peak.mean, peak.deviation) for peak in measured), strict=True)
        label = f"{name}, mean SNR {snr_db:.1f} dB"
        axes.errorbar(velocity + shift, means, sigmas, fmt="o", capsize=3, label=label)
        of_rows_db = [
            np.mean([bench.Peaks(peak.noisy[:, [row]], peak.ideal).snr_db for peak in measured[1:]])
            for row in range(bench.PIXELS)
        ]
        print(f"mean SNR of {method}: dissertation {stated_db} dB, one row; here, {name},", end=" ")
        print(f"{snr_db:.1f} ± {np.std(of_rows_db, ddof=1):.1f} dB")
    ideal = np.array([peak.ideal.mean() for peak in measured])
    curve = mean_response(bench.filter_step(method), phase * fine, phase, 1.0)
    axes.plot(velocity, ideal, "C2", label="edge without noise")
    axes.plot(fine, ideal.max() * curve / curve.max(), "k--", label="theoretical, sinusoid")
    axes.set(title=method, xlabel="image velocity (px/frame)")
    axes.set_ylabel(f"peak response ({bench.UNITS[method]})")
    axes.legend()
plt.show()
