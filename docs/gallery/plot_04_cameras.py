"""
Three lenses on one flight
==========================

A pinhole, a fisheye and a panorama fly ahead through a clearing. The flow of each is exact for its
own geometry. Hue is direction, pure from 4 px on. Lenses: :doc:`/how-to/lens`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta import scenes
from megalopta.flow import flow_to_rgb
from megalopta.render import RenderSettings, SceneRenderer, frame_seed

fisheye = {"fx_px": 80, "fy_px": 80, "cx_px": 99.5, "cy_px": 99.5, "fisheye": (0, 0, 0, 0)}
cameras = {
    "pinhole, 75°": scenes.PerspectiveCamera(width=200, height=200, fov_deg=75),
    "fisheye, 143°": scenes.OpenCVCamera(width=200, height=200, **fisheye),
    "panorama, 360°": scenes.EquirectangularCamera(width=400, height=200),
}
forest = scenes.Forest(preset="open", trees=80, seed=2)
light = scenes.Light(level="daylight", sky="natural")
path = scenes.Trajectory(frames=2, look_at_m=(10, 0, 1.5), velocity_m_s=(2, 0, 0))
settings = RenderSettings(samples_per_pixel=48, integrator="path", max_depth=6)

plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
blank = {"frame_on": False, "xticks": [], "yticks": []}
figure, axes = plt.subplots(2, 3, width_ratios=(1, 1, 2), subplot_kw=blank)
for (view, motion), (name, camera) in zip(axes.T, cameras.items()):
    renderer = SceneRenderer(scenes.build_scene(forest, light, camera, path), camera, settings)
    radiance = renderer.radiance(path.poses()[0], frame_seed(1, 0))
    flow = renderer.truth(path.poses(), 0).flow_forward
    speed = np.linalg.norm(flow, axis=-1, keepdims=True)
    view.imshow(scenes.preview(radiance, settings.bands_nm, forest.white(light)))
    view.set_title(name)
    motion.imshow(flow_to_rgb(flow / np.maximum(speed, 4), 1.01))
    motion.set_title("true flow")
figure.suptitle("Pinhole, fisheye or panorama: each has its own exact flow")
plt.show()
