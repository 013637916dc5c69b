"""
Motion blur, undone after the exposure
======================================

A SPAD array takes 512 bit planes while the camera turns by 64 px; their sum is blurred. With each
plane moved back along the known motion, it is sharp. Binary frames: :doc:`/how-to/events`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.scenes import CylindricalCamera, Forest, Light, Trajectory, build_scene
from megalopta.sensor import changed, detection_rate, expose_binary, preset

# On a cylinder, a turn of the camera moves all columns alike.
camera = CylindricalCamera(width=240, height=256, fov_deg=80, lower_deg=-33.5, upper_deg=39.6)
path, light = Trajectory(frames=2), Light(level="daylight")
settings = RenderSettings(samples_per_pixel=64, integrator="path", max_depth=6)
scene = build_scene(Forest(preset="open", trees=80, seed=2), light, camera, path)
radiance = SceneRenderer(scene, camera, settings).radiance(path.poses()[0], frame_seed(1, 0))
sensor = changed(preset("ideal"), exposure_s=10e-6)
rate_hz = detection_rate(radiance[None], settings.bands_nm, sensor)[0]
rate_hz *= 0.2 / (rate_hz.mean() * sensor.exposure_s)  # 0.2 photons per bit

as_taken, moved_back, planes_seen = np.zeros((256, 176)), np.zeros((256, 240)), np.zeros(240)
for turned_px in range(64):
    view_hz = np.broadcast_to(rate_hz[:, turned_px : turned_px + 176], (8, 256, 176))
    planes = np.unpackbits(expose_binary(view_hz, sensor, seed=turned_px, stream=0), axis=2)
    as_taken += planes.sum(axis=0)
    moved_back[:, turned_px : turned_px + 176] += planes.sum(axis=0)
    planes_seen[turned_px : turned_px + 176] += 8
plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
figure, axes = plt.subplots(1, 3, subplot_kw={"frame_on": False, "xticks": [], "yticks": []})
panels = planes[0], as_taken, moved_back[:, 32:208] / planes_seen[32:208]
for axis, panel, title in zip(axes, panels, ("one bit plane", "512, as taken", "512, moved back")):
    axis.imshow(panel, vmax=np.percentile(panel, 95))
    axis.set_title(title)
figure.suptitle("Single photons let motion blur be undone after the exposure")
plt.show()
