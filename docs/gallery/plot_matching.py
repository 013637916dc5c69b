"""
Whole pixels, small shifts, and both
====================================

Velocity that three methods find in bright frames of one texture, over its true shift. Block
matching steps from pixel to pixel; image interpolation is right up to about a pixel; matching by
Poisson likelihood interpolates between pixels. Theory: :doc:`/theory/matching`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import gaussian_filter, shift

from megalopta.flow import METHODS

rng = np.random.default_rng(0)
texture = np.exp(4 * gaussian_filter(rng.standard_normal((96, 96)), 2, mode="wrap"))
shifts_px = np.linspace(0, 4, 33)
for name in ("BM", "IIA", "PM"):
    found = []
    for moved in shifts_px:
        after = shift(texture, (0, moved), order=5, mode="grid-wrap")
        photons = rng.poisson(1e3 * np.stack([texture, after]).clip(1e-3)).astype(float)
        found.append(np.nanmedian(METHODS[name].respond(photons)[0, 2:-2, 2:-2, 0]))
    plt.plot(shifts_px, found, ".-", label=name)
plt.plot(shifts_px, shifts_px, "k:", lw=1, label="true")
plt.xlabel("shift (px)")
plt.ylabel("velocity found, median (px/frame)")
plt.legend()
plt.show()
