"""
Distance of methods from the Poisson bound
==========================================

Error of the velocity of blocks; the texture moves by 1.5 px per frame. No unbiased method that uses
the photons of its block alone gets into the gray area. Poisson matching also uses neighbors.
Explanation: :doc:`/explanation/poisson-bound`.
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

plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
figure, axes = plt.subplots()
methods = {"PM": "Poisson matching", "LK": "Lucas–Kanade", "BM": "block matching"}
for (name, label), style in zip(methods.items(), ("C0o-", "C1s-", "C2^-")):
    errors = []
    for flux in fluxes:
        counts = rng.poisson(flux * pair, (6, *pair.shape)).astype(float)
        velocity = [METHODS[name].respond(frames)[0, 2:-2, 2:-2, 0] for frames in counts]
        errors.append(np.nanmedian(np.abs(np.array(velocity) - 1.5)))
    axes.loglog(fluxes / 120**2, errors, style)
    axes.text(1000, errors[-1], label, color=style[:2], weight="bold")
information = fisher_information(pair[0], block_grid((120, 120)))[2:-2, 2:-2]  # of one photon
variance = np.median(cramer_rao_covariance(information)[..., 0, 0])
least = 0.6745 * np.sqrt(variance / fluxes)  # the median of normal errors
axes.fill_between(fluxes / 120**2, 1e-3, least, color="0.85")
axes.text(1, 0.01, "Poisson bound", weight="bold")
axes.set(xlabel="photons per pixel", ylabel="median error (px)", xlim=(0.6, 850), ylim=(5e-3, 1))
figure.suptitle("Photon noise sets a bound, and Poisson matching reaches it")
plt.show()
