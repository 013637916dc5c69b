"""
Truth at an edge
================

A box passes before a wall: its true flow in color, and in white what is hidden in the next frame.
Flow jumps at the edge, from pixel center to pixel center; ``truth.footprint`` tells what else a
pixel holds. Explanation:
:doc:`/explanation/truth-at-edges`.
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

image = flow_to_rgb(truth.flow_forward, float(np.nanmax(np.abs(truth.flow_forward))))
figure, axes = plt.subplots(1, 2, figsize=(8, 4), layout="constrained")
axes[0].imshow(image)
axes[0].set_title("flow to the next frame")
axes[1].imshow(truth.occluded_forward, cmap="gray")
axes[1].set_title("hidden in the next frame")
plt.show()
