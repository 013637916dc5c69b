"""From a scene to N_2b: render, expose, detect motion, and ask how many photons that takes.

`python examples/pipeline.py` takes half a minute. The program's stages do the same, a frame at a
time and on disk; every function here is public.
"""

import numpy as np

from megalopta.flow import BenchmarkSettings, optical_flow, photon_benchmark
from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene
from megalopta.sensor import changed, expose, photon_rate, preset

SEED = 1
FRAMES, SIZE_PX = 12, 32

# Scene, light and camera
forest = Forest(trees=20, seed=SEED)
dusk = Light(level="twilight")
camera = PerspectiveCamera(width=SIZE_PX, height=SIZE_PX, fov_deg=75)
flight = Trajectory(frames=FRAMES, frame_rate_hz=10, rotation_deg_s=10, velocity_m_s=(1, 0, 0))
scene = build_scene(forest, dusk, camera, flight)

# Light and truth of every frame
settings = RenderSettings(samples_per_pixel=16)
renderer = SceneRenderer(scene, camera, settings)
poses = flight.poses()
frames = [renderer.radiance(pose, frame_seed(SEED, n)) for n, pose in enumerate(poses)]
radiance = np.stack(frames)  # (T, H, W, bands), W·m⁻²·sr⁻¹·nm⁻¹
truth = renderer.truth(poses, FRAMES // 2)

# Photons that a SPAD array counts in each frame
sensor = changed(preset("richardson-130nm"), exposure_s=0.05)
exposure = expose(radiance, settings.bands_nm, sensor, seed=SEED, stream="example")
print(f"{exposure.counts.mean():.0f} counts per pixel and frame")

# Motion of the counts, against the true motion
pair = exposure.counts[FRAMES // 2 : FRAMES // 2 + 2].astype(float)
flow = optical_flow(*pair, method="DIS")
errors_px = np.linalg.norm(flow - truth.flow_forward, axis=-1)
known = ~truth.occluded_forward & ~truth.out_of_view_forward & np.isfinite(errors_px)
print(f"DIS is off by {np.median(errors_px[known]):.2f} px in half of the pixels")

# Photons that a detector needs to answer to 2 bits: from the light, drawn at one flux after another
light = photon_rate(radiance, settings.bands_nm, preset("ideal"))
search = BenchmarkSettings(sizes=(SIZE_PX,), metrics=("literal",))
result = photon_benchmark(light, ["BM", "DIS", "PF"], search, seed=SEED, sequence="example")
for curve in result.curves:
    print(f"{curve.method}: N_2b = {curve.thresholds[2]} photons per frame")
