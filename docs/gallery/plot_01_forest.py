"""
From noon to starlight, millions of photons become one
======================================================

One open forest in its own light, and what a pixel of 60 µm behind f/1.4 counts of it in 3 ms. Views
are exposed for their light; counts are white at their brightest 10 %. How to render from Python:
:doc:`/how-to/python`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta import scenes
from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.sensor import changed, expose, preset

forest = scenes.Forest(preset="open", trees=80)
camera = scenes.PerspectiveCamera(width=216, height=184)
path = scenes.Trajectory(frames=2, look_at_m=(10, 0, 2.0))
settings = RenderSettings(samples_per_pixel=96, integrator="path", max_depth=6)
sensor = changed(preset("ideal"), exposure_s=3e-3)

plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
figure, axes = plt.subplots(2, 4, subplot_kw={"frame_on": False, "xticks": [], "yticks": []})
for (view, counted), name in zip(axes.T, ("daylight", "twilight", "full_moon", "starlight")):
    light = scenes.Light.model_validate({"level": name, "sky": "natural", "disc_azimuth_deg": 150})
    renderer = SceneRenderer(scenes.build_scene(forest, light, camera, path), camera, settings)
    radiance = renderer.radiance(path.poses()[0], frame_seed(1, 0))
    counts = expose(radiance[None], settings.bands_nm, sensor, seed=1, stream=name).counts[0]
    view.imshow(scenes.preview(radiance, settings.bands_nm, forest.white(light)))
    view.set_title(f"{name.replace('_', ' ')}\n{scenes.LEVELS[name].illuminance_lux:,g} lux")
    counted.imshow(counts, vmin=0, vmax=max(np.percentile(counts, 90), 1))
    counted.set_title(f"{float(f'{counts.mean():.2g}'):,.0f}")
axes[0, 0].set_ylabel("light")
axes[1, 0].set_ylabel("photons")
figure.suptitle("From noon to starlight, millions of photons per pixel become one")
plt.show()
