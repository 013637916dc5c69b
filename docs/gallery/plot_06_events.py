"""
A photon counter and an event camera as light fades
===================================================

A camera turns by 4 px in 10 ms. A SPAD array counts photons; an event camera reports where light
rises (purple) or falls by a fifth, and becomes slow in the dark. :doc:`/how-to/event-camera`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta import sensor
from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.scenes import CylindricalCamera, Forest, Light, Trajectory, build_scene

camera = CylindricalCamera(width=244, height=160, fov_deg=80, lower_deg=-22, upper_deg=26)
path, light = Trajectory(frames=2), Light(level="daylight")
settings = RenderSettings(samples_per_pixel=96, integrator="path", max_depth=6)
scene = build_scene(Forest(preset="open", trees=80, seed=2), light, camera, path)
radiance = SceneRenderer(scene, camera, settings).radiance(path.poses()[0], frame_seed(1, 0))
views = np.stack([radiance[:, turned : turned + 240] for turned in range(5)])
counter = sensor.changed(sensor.preset("canon-3mp"), exposure_s=0.01)
davis = sensor.IMAGE_SENSORS["davis346"]
assert isinstance(davis, sensor.ContrastSensor)
plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
figure, axes = plt.subplots(2, 3, subplot_kw={"frame_on": False, "xticks": [], "yticks": []})
for (top, bottom), lux in zip(axes.T, (100, 10, 1)):
    dimmed, bands_nm = lux / 1e5 * views, settings.bands_nm
    photons = sensor.detected_photons(dimmed, bands_nm, counter).mean(axis=0, keepdims=True)
    counts = sensor.expose_rate(photons / 0.01, counter, seed=0, stream="turn").counts[0]
    rates_hz = sensor.detected_photons(dimmed, bands_nm, davis)[None] / 0.01
    events = sensor.expose_events(rates_hz, davis, seed=0, stream="turn")
    change = np.zeros(counts.shape)
    np.add.at(change, (events.row, events.column), 2.0 * np.array(events.polarity) - 1)
    top.imshow(counts, vmax=np.percentile(counts, 95))
    top.set_title(f"{lux} lux: {counts.mean():,.0f} photons")
    bottom.imshow(change, cmap="PuOr", vmin=-2, vmax=2)
    bottom.set_title(f"{events.time_s.size / counts.size:.2g} events per pixel")
figure.suptitle("An event camera goes blind before a photon counter does")
plt.show()
