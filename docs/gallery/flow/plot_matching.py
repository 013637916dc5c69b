"""
Block matching, interpolation and Poisson matching
==================================================

Velocity that three methods estimate in bright frames of one texture, over its true shift. Block
matching (BM) steps from pixel to pixel. Image interpolation (IIA) is right up to about 1 px.
Matching by Poisson likelihood (PM) interpolates between pixels. Theory: :doc:`/theory/matching`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import gaussian_filter, shift

from megalopta.flow import METHODS

rng = np.random.default_rng(0)
texture = np.exp(4 * gaussian_filter(rng.standard_normal((96, 96)), 2, mode="wrap"))
shifts_px = np.linspace(0, 4, 33)
for name, marker in zip(("BM", "IIA", "PM"), "os^", strict=True):
    found = []
    for moved in shifts_px:
        after = shift(texture, (0, moved), order=5, mode="grid-wrap")
        photons = rng.poisson(1e3 * np.stack([texture, after]).clip(1e-3)).astype(float)
        found.append(np.nanmedian(METHODS[name].respond(photons)[0, 2:-2, 2:-2, 0]))
    plt.plot(shifts_px, found, f"{marker}-", ms=4, label=name)
plt.plot(shifts_px, shifts_px, "k:", lw=1, label="true", zorder=3)
plt.xlabel("true shift (px per frame)")
plt.ylabel("median velocity estimate (px per frame)")
plt.legend()
plt.show()
