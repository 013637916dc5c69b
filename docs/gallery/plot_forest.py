"""
A forest in fewer and fewer photons
===================================

A clearing by day, rendered once, and the counts of a SPAD array without noise of its own as the
light dims. The trees disappear before the sky between them does. How to render from Python:
:doc:`/how-to/python`.
"""

import matplotlib.pyplot as plt

from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene, preview
from megalopta.sensor import changed, expose, preset

forest, day = Forest(preset="clearing", trees=80), Light(level="daylight", sky="natural")
camera = PerspectiveCamera(width=192, height=128, fov_deg=75)
path = Trajectory(frames=2, look_at_m=(10, 0, 2.4), velocity_m_s=(1, 0, 0))
settings = RenderSettings(samples_per_pixel=100)
renderer = SceneRenderer(build_scene(forest, day, camera, path), camera, settings)
radiance = renderer.radiance(path.poses()[0], frame_seed(1, 0))

figure, axes = plt.subplots(2, 2, figsize=(9, 6.4), layout="constrained")
axes.flat[0].imshow(preview(radiance, settings.bands_nm, forest.white(day)))
axes.flat[0].set_title("rendered light")
sensor = changed(preset("ideal"), exposure_s=2e-3)
for axis, dimming in zip(axes.flat[1:], (1e-5, 1e-7, 1e-8), strict=True):
    light = dimming * radiance[None]
    counts = expose(light, settings.bands_nm, sensor, seed=1, stream="clearing").counts[0]
    axis.imshow(counts, cmap="gray", vmin=0, vmax=max(4 * counts.mean(), 1))
    axis.set_title(f"{counts.mean():.3g} photons per pixel")
for axis in axes.flat:
    axis.set_axis_off()
plt.show()
