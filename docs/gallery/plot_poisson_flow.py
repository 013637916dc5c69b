"""
Flow of a whole frame at three photons per pixel
================================================

A disk moves in front of a background that moves differently: photon counts, the true flow, and the
flow that Poisson flow (PF), DIS and Poisson block matching (PM) estimate from two frames. Hue is
direction (red: to the right), the pure color 1.5 px per frame. Theory:
:doc:`/theory/whole-frame-flow`.
"""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from scipy.ndimage import gaussian_filter, zoom

from megalopta.flow import METHODS, Layer, MovingLayers, flow_to_rgb

rng = np.random.default_rng(0)
leaves = np.exp(6 * gaussian_filter(rng.standard_normal((2, 360, 360)), (0, 3, 3), mode="wrap"))
ground = Layer(leaves[0], (1.2, 0.6), np.zeros((2, 2)))
disk = Layer(leaves[1], (-1.2, 0.0), np.zeros((2, 2)), disk=(0.0, 0.0, 40.0))
scene, shape = MovingLayers([ground, disk]), (168, 168)
light = scene.light(shape, (0.0, 1.0))
counts = rng.poisson(3 * light / light.mean()).astype(float)
methods: dict[str, Any] = dict(METHODS)
blocks = methods["PM"].respond(counts)[0]
flows = {
    "true flow": scene.flow(shape, 0.0),
    "PF": methods["PF"].dense(*counts),
    "DIS": methods["DIS"].dense(*counts),
    "PM, by blocks": zoom(blocks, (168 / len(blocks), 168 / blocks.shape[1], 1), order=0),
}

figure, axes = plt.subplots(1, 5, figsize=(12, 2.8), layout="constrained")
image = axes[0].imshow(counts[0], cmap="gray", vmax=10)
figure.colorbar(image, ax=axes[0], label="photons", location="left", shrink=0.7)
axes[0].set_title("counts")
for axis, (name, flow) in zip(axes[1:], flows.items(), strict=True):
    axis.imshow(flow_to_rgb(flow, 1.5))
    axis.set_title(name)
for axis in axes:
    axis.set_axis_off()
plt.show()
