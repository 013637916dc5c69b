"""
Parts of the light at night
===========================

Irradiance of an open plane in twilight, under a quarter moon and on a moonless night: the sum (wide
gray line) and its parts. The moon dominates visible light, airglow dominates what an InGaAs array
sees. Theory: :doc:`/theory/outdoor-light`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.scenes import LEVELS

grid = np.arange(400, 1701)
figure, axes = plt.subplots(1, 3, figsize=(11, 3.8), sharey=True, layout="constrained")
parts = ("twilight", "moon", "moonlit sky", "airglow", "starlight")
colors = {name: f"C{number}" for number, name in enumerate(parts)}
for axis, name in zip(axes, ("twilight", "quarter_moon", "starlight"), strict=True):
    level = LEVELS[name]
    axis.semilogy(grid, level.spectrum()(grid), color="black", linewidth=3, alpha=0.3)
    for part in level.components:
        label = f"{part.name}, {part.illuminance_lux:.2g} lux"
        axis.semilogy(grid, part.irradiance(grid), color=colors[part.name], label=label)
    axis.set_title(f"{name.replace('_', ' ')}, {level.illuminance_lux:g} lux")
    axis.set_xlabel("wavelength (nm)")
    axis.legend(loc="lower left", fontsize="small")
axes[0].set_ylim(1e-12, 1e-4)
axes[0].set_ylabel("irradiance (W·m⁻²·nm⁻¹)")
plt.show()
