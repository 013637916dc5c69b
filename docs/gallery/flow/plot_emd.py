"""
A detector of direction
=======================

Mean response of EMD to a sinusoid that moves right (positive temporal frequencies) or left. Points
come from frames, the line from the gains of its filters. The response grows with speed up to the
corner of the filters, then falls: one response belongs to two speeds. Theory:
:doc:`/theory/correlators`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.flow import METHODS

PHASE, CONTRAST = 0.3, 0.8
detector = METHODS["EMD"]
t, x = np.arange(1500)[:, None], np.arange(40)[None, :]
omegas = np.linspace(-3, 3, 25)
found = []
for omega in omegas:
    frames = (0.5 * (1 + CONTRAST * np.sin(omega * t - PHASE * x)))[:, None, :]
    found.append(detector.respond(frames)[300:].mean(axis=0)[0, 5:-5].mean())

fine = np.linspace(-3.1, 3.1, 400)
step, z = detector.model_dump()["filter_step"], np.exp(-1j * fine)
delay = step / (1 - (1 - step) * z)
high_pass = (1 - step) * (1 - z) / (1 - (1 - step) * z)
plt.figure(layout="constrained")
plt.plot(fine, -(CONTRAST**2) / 4 * np.abs(high_pass) ** 2 * delay.imag * np.sin(PHASE))
plt.plot(omegas, found, "o")
plt.axhline(0, color="gray", lw=0.5)
plt.xlabel("temporal frequency (rad/frame)")
plt.ylabel("mean response")
plt.show()
