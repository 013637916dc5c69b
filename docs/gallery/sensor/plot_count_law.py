"""
Dead time narrows the distribution of counts
============================================

Distribution of the counts of a non-paralyzable pixel: simulated (steps) and exact (points), an
incomplete gamma function. Its variance is far below its mean. Theory: :doc:`/theory/dead-time`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.special import gammainc
from scipy.stats import poisson

RATE_HZ, EXPOSURE_S, DEAD_TIME_S = 2e6, 2e-5, 0.5e-6

rng = np.random.default_rng(0)
waits = rng.exponential(1 / RATE_HZ, (20_000, 60))
times = np.cumsum(waits, axis=1) + DEAD_TIME_S * np.arange(60)  # after a count comes a dead time
counts = (times < EXPOSURE_S).sum(axis=1)

n = np.arange(60)
left = np.maximum(RATE_HZ * (EXPOSURE_S - (n - 1) * DEAD_TIME_S), 0)
at_least = np.where(n == 0, 1, gammainc(np.maximum(n, 1), left))
exact = at_least - np.append(at_least[1:], 0)

plt.step(n, np.bincount(counts, minlength=60) / counts.size, where="mid", label="simulated")
plt.plot(n, exact, "o", ms=4, label="exact")
plt.plot(n, poisson.pmf(n, exact @ n), "k:", label="Poisson, same mean")
plt.xlabel("counts in an exposure of 20 µs")
plt.ylabel("probability")
plt.legend()
plt.show()
