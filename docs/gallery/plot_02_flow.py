"""
Motion in ten photons per pixel
===============================

Counts of a flight through a forest, and the flow that Poisson flow (PF) finds in two frames of
them, next to the light and the true flow. Hue is direction. :doc:`/theory/whole-frame-flow`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.flow import flow_to_rgb, optical_flow
from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene

camera = PerspectiveCamera(width=224, height=224, fov_deg=70)
path = Trajectory(frames=2, look_at_m=(10, 0, 2.5), velocity_m_s=(1.5, 1.5, 0), rotation_deg_s=-6)
scene = build_scene(Forest(preset="open", trees=80, seed=2), Light(level="daylight"), camera, path)
settings = RenderSettings(samples_per_pixel=64, integrator="path", max_depth=6)
renderer, poses = SceneRenderer(scene, camera, settings), path.poses()
light = np.stack([renderer.radiance(poses[at], frame_seed(1, at)).mean(axis=-1) for at in (0, 1)])
true_flow = renderer.truth(poses, 0).flow_forward
fastest = np.nanpercentile(np.hypot(*np.moveaxis(true_flow, -1, 0)), 99.5)

plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
figure, axes = plt.subplots(2, 4, subplot_kw={"frame_on": False, "xticks": [], "yticks": []})
for (top, bottom), photons in zip(axes.T, (1, 10, 100)):
    counts = np.random.default_rng(0).poisson(photons * light / light.mean())
    flow = optical_flow(*counts)
    error = np.nanmedian(np.linalg.norm(flow - true_flow, axis=-1))
    top.imshow(counts[0], vmin=0, vmax=np.percentile(counts, 90))
    top.set_title(f"{photons} photon{'s' * (photons > 1)}")
    bottom.imshow(flow_to_rgb(flow, fastest))
    bottom.set_title(f"PF, off by {error:.2f} px")
axes[0, 3].imshow(light[0], vmin=0, vmax=np.percentile(light, 90))
axes[0, 3].set_title("light")
axes[1, 3].imshow(flow_to_rgb(true_flow, fastest))
axes[1, 3].set_title(f"truth, to {fastest:.0f} px")
figure.suptitle("Ten photons per pixel are enough to see how a forest moves")
plt.show()
