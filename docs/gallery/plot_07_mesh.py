"""
Your own mesh in moonlight
==========================

Pawns under a full moon, and their photons in 30 µs. Any mesh, with flow: :doc:`/how-to/meshes`.
"""

import matplotlib.pyplot as plt
import numpy as np
import trimesh

from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.scenes import Light, Meshes, PerspectiveCamera, Trajectory, build_scene, preview
from megalopta.sensor import changed, expose, preset

profile = [(0, 0), (0.36, 0), (0.36, 0.1), (0.2, 0.2), (0.11, 0.6), (0.22, 0.66)]
profile += [(0.2 * np.cos(a), 0.9 + 0.2 * np.sin(a)) for a in np.linspace(-1.2, np.pi / 2, 12)]
parts: tuple[list[trimesh.Trimesh], ...] = [], []
for x, y in np.ndindex(8, 8):
    parts[(x + y) % 2].append(trimesh.creation.box(bounds=[(x, y, -0.1), (x + 1, y + 1, 0)]))
    if y + (x == 3) in (1, 6):
        parts[y < 4].append(trimesh.creation.revolve(profile, sections=48))
        parts[y < 4][-1].apply_translation((x + 0.5, y + 0.5, 0))
chess = trimesh.Scene(dict(zip("bw", map(trimesh.util.concatenate, parts))))
chess.export("pawn.glb")
mesh = {"files": {"file": "pawn.glb", "up": "z"}, "materials": {"b": 0.1, "w": 0.7}, "ground": 0.1}
board, light = Meshes.model_validate(mesh), Light(level="full_moon", disc_elevation_deg=25)
path = Trajectory(frames=2, position_m=(-1.2, -2, 5.5), look_at_m=(3.9, 3.7, 0))
camera = PerspectiveCamera(width=300, height=300, fov_deg=64)
settings = RenderSettings(samples_per_pixel=96)
renderer = SceneRenderer(build_scene(board, light, camera, path), camera, settings)
radiance = renderer.radiance(path.poses()[0], frame_seed(1, 0))
sensor = changed(preset("ideal"), exposure_s=3e-5)
counts = expose(radiance[None], settings.bands_nm, sensor, seed=1, stream=0).counts[0]
plt.style.use(["megalopta.report.house", "megalopta.report.slide"])
figure, axes = plt.subplots(1, 2, subplot_kw={"frame_on": False, "xticks": [], "yticks": []})
axes[0].imshow(preview(radiance, settings.bands_nm, board.white(light)))
axes[1].imshow(counts, vmax=np.percentile(counts, 98))
figure.suptitle(f"Your own mesh in moonlight, and in {counts.mean():.0f} photons per pixel")
plt.show()
