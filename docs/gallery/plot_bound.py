"""
Distance of methods from the Poisson bound
==========================================

Median error of the velocities of blocks over the photons of a frame; the texture moves by 1.5 px
per frame. The dashed line is the least error that photon noise allows an unbiased method that uses
the block's own photons. PM smooths over neighboring blocks, so it can be below. Explanation:
:doc:`/explanation/poisson-bound`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import gaussian_filter, shift

from megalopta.flow import METHODS, block_grid, cramer_rao_covariance, fisher_information

rng = np.random.default_rng(0)
texture = np.exp(8 * gaussian_filter(rng.standard_normal((120, 120)), 2, mode="wrap"))
pair = np.stack([texture, shift(texture, (0, 1.5), order=5, mode="grid-wrap")]).clip(1e-3)
pair /= pair[0].sum()
fluxes = np.geomspace(1e4, 1e7, 7)

for name, marker in zip(("PM", "LK", "BM"), "os^", strict=True):
    errors = []
    for flux in fluxes:
        draws = rng.poisson(flux * pair, (6, *pair.shape)).astype(float)
        found = [METHODS[name].respond(draw)[0, 2:-2, 2:-2, 0] for draw in draws]
        errors.append(np.nanmedian(np.abs(np.array(found) - 1.5)))
    plt.loglog(fluxes, np.maximum(errors, 1e-3), f"{marker}-", label=name)
information = fisher_information(pair[0], block_grid((120, 120)))[2:-2, 2:-2]  # of one photon
variance = np.median(cramer_rao_covariance(information)[..., 0, 0])
least = 0.6745 * np.sqrt(variance / fluxes)  # the median of normal errors
plt.loglog(fluxes, least, "k--", label="Poisson bound")
plt.xlabel("photons per frame")
plt.ylabel("median error along x (px)")
plt.legend()
plt.show()
