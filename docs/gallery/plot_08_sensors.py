"""
Four cameras by moonlight
=========================

A forest by a full moon, and the same dimmed to a hundredth of a lux, on the pixels of four cameras
as sold: 40 ms behind f/1.4. Readings are stretched. All presets: :doc:`/reference/sensors`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene
from megalopta.sensor import IMAGE_SENSORS, changed, expose

names = {"CMOS": "imx174", "EMCCD": "ixon-888", "SPAD": "canon-3mp", "early SPAD": "mandai-180nm"}
forest, light = Forest(preset="open", trees=80), Light(level="full_moon", sky="natural")
camera = PerspectiveCamera(width=200, height=204, fov_deg=62)
path = Trajectory(frames=2, look_at_m=(10, 0, 2.0))
settings = RenderSettings(samples_per_pixel=96, integrator="path", max_depth=6)
renderer = SceneRenderer(build_scene(forest, light, camera, path), camera, settings)
radiance = renderer.radiance(path.poses()[0], frame_seed(1, 0))[None]

plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
figure, axes = plt.subplots(2, 4, subplot_kw={"frame_on": False, "xticks": [], "yticks": []})
for column, (name, preset) in zip(axes.T, names.items()):
    sensor = changed(IMAGE_SENSORS[preset], exposure_s=0.04)
    for axis, dimming in zip(column, (1, 0.04)):
        frame = expose(dimming * radiance, settings.bands_nm, sensor, seed=1, stream=name)
        low, high = np.percentile(frame.counts, (1, 99))
        axis.imshow(frame.counts[0], vmin=low, vmax=max(high, low + 1))
    column[0].set_title(f"{name}, {1e6 * sensor.pitch_m:.1f} µm")
axes[0, 0].set_ylabel("0.25 lux")
axes[1, 0].set_ylabel("0.01 lux")
figure.suptitle("At a hundredth of a lux, the camera decides what is seen")
plt.show()
