"""
The camera's turn from two frames and from eight
================================================

A camera that sees all around turns by 1.7° per frame. The most likely motion is estimated from the
counts of two frames and of eight; in theory the errors differ by √84. Errors are root mean squares
of five draws. Theory: :doc:`/theory/camera-motion`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.flow import likely_camera_motion
from megalopta.scenes import EquirectangularCamera

camera, turn_deg = EquirectangularCamera(width=72, height=36, fov_deg=360), 1.7
y, x = np.mgrid[:36, :72]
seen = [2 * np.pi * x / 72 + np.radians(turn_deg) * t for t in range(8)]
light = 1 + 0.4 * np.array([np.sin(7 * each + y / 5) + np.sin(4 * each - y / 3) for each in seen])

rng, photons = np.random.default_rng(0), [3, 10, 30, 100]
figure, axes = plt.subplots()
for frames, marker in ((2, "o"), (8, "s")):
    errors_deg = []
    for level in photons:
        drawn = [rng.poisson(level * light[:frames]) for _ in range(5)]
        turns = [likely_camera_motion(counts, camera).rotation_deg[1] for counts in drawn]
        errors_deg.append(np.sqrt(np.mean(np.subtract(turns, turn_deg) ** 2)))
    axes.loglog(photons, errors_deg, f"{marker}-", label=f"{frames} frames")
axes.set(xlabel="photons per pixel and frame", ylabel="error of the turn (° per frame)")
axes.legend()
plt.show()
