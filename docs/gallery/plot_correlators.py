"""
What correlation detectors respond to
=====================================

Mean responses of NDM and NDS to a moving sinusoid over its temporal frequency. Points come from
frames, lines from the closed form. The detectors respond to temporal frequency and contrast, not to
speed. Theory: :doc:`/theory/correlators`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.flow import METHODS, ndm_mean, nds_mean

PHASE, CONTRAST = 0.3, 0.8
t, x = np.arange(1200)[:, None], np.arange(40)[None, :]
omegas = np.linspace(0.1, 3, 12)
fine = np.linspace(0.05, 3.1, 200)

for name, closed_form in (("NDM", ndm_mean), ("NDS", nds_mean)):
    detector = METHODS[name]
    found = []
    for omega in omegas:
        frames = (0.5 * (1 + CONTRAST * np.sin(omega * t - PHASE * x)))[:, None, :]
        found.append(detector.respond(frames)[200:].mean(axis=0)[0, 5:-5].mean())
    (line,) = plt.plot(
        fine, closed_form(detector.model_dump()["filter_step"], fine, PHASE, CONTRAST), label=name
    )
    plt.plot(omegas, found, "o", color=line.get_color())
plt.xlabel("temporal frequency (rad/frame)")
plt.ylabel("mean response")
plt.legend()
plt.show()
