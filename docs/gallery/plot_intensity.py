"""
Ten photons for two bits
========================

The mean relative error of one Poisson count, simulated (points) and in closed form (line), is 25 %
at 10.13 photons. N_2b of a plain intensity measurement is that times the number of pixels.
Explanation: :doc:`/explanation/n2b`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.special import gammaln

photons = np.geomspace(1, 1000, 13)
fine = np.geomspace(1, 1000, 2000)
floor = np.floor(fine)
exact = 2 * np.exp(floor * np.log(fine) - fine - gammaln(floor + 1))

rng = np.random.default_rng(0)
drawn = [np.abs(rng.poisson(mean, 20_000) / mean - 1).mean() for mean in photons]

plt.figure(layout="constrained")
plt.loglog(fine, exact, label="E|X − λ| / λ")
plt.loglog(photons, drawn, "o", label="simulated")
plt.axhline(0.25, color="gray", ls=":")
plt.axvline(10.133, color="gray", ls=":")
plt.xlabel("mean photons λ")
plt.ylabel("mean relative error")
plt.legend()
plt.show()
