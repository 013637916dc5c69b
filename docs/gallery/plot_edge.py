"""
Ground truth at a depth edge
============================

A box passes in front of a wall: its true flow (red: to the right), and in white what is hidden in
the next frame. Flow jumps at the edge from one pixel to the next; ``truth.footprint`` says what
else a pixel holds. Explanation: :doc:`/explanation/truth-at-edges`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.flow import flow_to_rgb
from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import (
    Grating,
    Light,
    MovingObject,
    PerspectiveCamera,
    Trajectory,
    build_scene,
)

camera, trajectory = PerspectiveCamera(width=96, height=96, fov_deg=60), Trajectory(frames=2)
box = MovingObject(
    position_m=(3, 0.3, 1.5), size_m=(0.8, 0.8, 0.8), motion={"velocity_m_s": (0, -2, 0)}
)
scene = build_scene(Grating(), Light(), camera, trajectory, objects=(box,))
renderer = SceneRenderer(scene, camera, RenderSettings(samples_per_pixel=1))
truth = renderer.truth(trajectory.poses(), 0, trajectory.times_s)

fastest = float(np.nanmax(np.abs(truth.flow_forward)))
figure, axes = plt.subplots(1, 2, figsize=(8, 4), layout="constrained")
axes[0].imshow(flow_to_rgb(truth.flow_forward, fastest))
axes[0].set_title(f"flow, up to {fastest:.1f} px per frame")
axes[1].imshow(truth.occluded_forward, cmap="gray")
axes[1].set_title("hidden in the next frame")
for axis in axes:
    axis.set(xlabel="column (px)", ylabel="row (px)")
plt.show()
