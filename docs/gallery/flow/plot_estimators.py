"""
Estimators for pictures in low light
====================================

Median error of one velocity of 1.5 px per frame over the photons per pixel. DIS and TV-L1, which
smooth their flow over the frame, need the least light. PC estimates one velocity for the whole
frame, and is 0.2 px off even in the brightest. Theory: :doc:`/theory/estimators`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import gaussian_filter, shift

from megalopta.flow import METHODS

rng = np.random.default_rng(0)
texture = np.exp(4 * gaussian_filter(rng.standard_normal((96, 96)), 2, mode="wrap"))
pair = np.stack([texture, shift(texture, (0, 1.5), order=5, mode="grid-wrap")]).clip(1e-3)
pair /= pair.mean()
photons = np.geomspace(0.1, 1000, 9)

for name, marker in zip(("LK", "FB", "DIS", "TV-L1", "PC"), "os^Dv", strict=True):
    errors = []
    for mean in photons:
        draws = rng.poisson(mean * pair, (4, *pair.shape)).astype(float)
        found = np.array([METHODS[name].respond(draw)[0] for draw in draws])
        errors.append(np.nanmedian(np.hypot(found[..., 0] - 1.5, found[..., 1])))
    plt.loglog(photons, np.maximum(errors, 1e-2), f"{marker}-", label=name)
plt.axhline(1.5, color="gray", ls=":", label="zero motion")
plt.xlabel("photons per pixel and frame")
plt.ylabel("median endpoint error (px)")
plt.legend()
plt.show()
