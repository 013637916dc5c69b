"""
One flight, and all that is known of it
=======================================

A frame of a flight through a forest, with the truth that is rendered with it: exact at the middle
of every pixel, and without a label drawn by hand. All maps: :doc:`/reference/dataset-files`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.flow import flow_to_rgb
from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene, preview

forest, light = Forest(preset="open", trees=80, seed=2), Light(sky="natural", level="daylight")
camera = PerspectiveCamera(width=288, height=200, fov_deg=75)
path = Trajectory(frames=2, look_at_m=(10, 0, 1.5), velocity_m_s=(0.5, 1.5, 0))
settings = RenderSettings(samples_per_pixel=64, integrator="path", max_depth=6)
renderer = SceneRenderer(build_scene(forest, light, camera, path), camera, settings)
radiance = renderer.radiance(path.poses()[0], frame_seed(1, 0))
truth = renderer.truth(path.poses(), 0)

plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
figure, axes = plt.subplots(2, 3, subplot_kw={"frame_on": False, "xticks": [], "yticks": []})
speed = np.nanpercentile(np.hypot(*np.moveaxis(truth.flow_forward, -1, 0)), 99.5)
colors = np.random.default_rng(3).uniform(0.1, 1, (256, 3))
panels = {
    "light": preview(radiance, settings.bands_nm, forest.white(light)),
    "distance, 2 to 40 m": np.log(truth.depth.clip(2, 40)),
    "objects": colors[truth.object_id % 256],
    f"flow, up to {speed:.0f} px": flow_to_rgb(truth.flow_forward, speed),
    "hidden in the next frame": truth.occluded_forward,
    "direction of surfaces": (1 + np.nan_to_num(truth.normal, nan=1)) / 2,
}
for axis, (title, panel) in zip(axes.flat, panels.items()):
    axis.imshow(panel, cmap="cividis_r" if title.startswith("dist") else "gray")
    axis.set_title(title)
figure.suptitle("Every pixel of a flight comes with its truth")
plt.show()
