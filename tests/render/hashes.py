"""Print SHA-256 of radiance and truth of small scenes: `python -m tests.render.hashes FOLDER`."""

import hashlib
import sys
from pathlib import Path

import numpy as np

from megalopta.config.model import parse
from megalopta.render import SceneRenderer, write_radiance, write_truth
from megalopta.render.exr import read_channels
from megalopta.scenes import Shutter, build_scene
from tests.scenes.meshes.files import Gltf, png

PINHOLE = "camera: {width: 24, height: 16}\n"
TREES = "scene: {kind: forest, trees: 6, density_per_ha: 100}\ntrajectory: {frames: 3}\n"
MOVING = "objects: [{position_m: [2, 0, 2], motion: {velocity_m_s: [0, 5, 0]}}]\n" + PINHOLE
LENS = "camera: {kind: opencv, width: 24, height: 16, fx_px: 20, fy_px: 20, cx_px: 12, cy_px: 8, "
XML = """<scene version="3.0.0"><bsdf type="diffuse" id="tiled"><texture type="bitmap" name=
"reflectance"><string name="filename" value="tiles.png"/></texture></bsdf><shape type="rectangle">
<transform name="to_world"><scale value="4"/></transform><ref id="tiled"/></shape><shape type=
"sphere"><point name="center" x="1.5" y="-1" z="0.7"/><bsdf type="METAL"/></shape></scene>"""
OWN = "scene: {kind: meshes, files: %s, ground: 0.2}\ntrajectory: {kind: orbit, radius_m: 9}\n"
SCENES = {
    "grating": "scene: {kind: grating}\n" + PINHOLE,
    "forest": TREES + PINHOLE,
    "object": TREES + MOVING,
    "rolling": TREES + MOVING,
    "panorama": TREES + "camera: {kind: equirectangular, width: 32, height: 16}\n",
    "opencv": TREES + LENS + "distortion: [-0.1, 0.01, 0.001, 0.002, 0.0]}\n",
    "fisheye": TREES + LENS + "fisheye: [0.1, 0.01, 0.0, 0.0]}\n",
    **{name: OWN % name + PINHOLE for name in ("model.glb", "diffuse.xml", "conductor.xml")},
}

folder = Path(sys.argv[1])
pixels = png(np.random.default_rng(1).integers(0, 255, (4, 4, 3)))
(folder / "tiles.png").write_bytes(pixels)
for kind in ("diffuse", "conductor"):
    (folder / f"{kind}.xml").write_text(XML.replace("METAL", kind))
model = Gltf()
model.paint(pixels)
uv = model.accessor(np.array([[0, 0], [1, 0], [0, 1]], np.float32))
model.triangle(5 * np.eye(3, dtype=np.float32), material=0, TEXCOORD_0=uv)
(folder / "model.glb").write_bytes(model.glb())
shutter = Shutter(exposure_s=0.004, readout_s=0.01)
for name, integrator in [(name, kind) for name in SCENES for kind in ("path", "baked")][:-1]:
    render = f"render: {{samples_per_pixel: 4, max_depth: 4, integrator: {integrator}}}\n"
    given = parse(SCENES[name] + render, name, folder=folder)
    path, poses = given.trajectory, given.trajectory.poses()
    scene = build_scene(given.scene, given.light, given.camera, path, given.objects)
    renderer = SceneRenderer(scene, given.camera, given.render, poses)
    radiance = renderer.radiance(poses[1], 1, float(path.times_s[1]))
    truth = renderer.truth(poses, 1, path.times_s)
    if name == "rolling":
        radiance = renderer.exposed(path, shutter, 1, seed=1)
        truth = renderer.shutter_truth(path, shutter, 1)
    write_radiance(folder / "0.exr", radiance, given.render.bands_nm)
    write_truth(folder / "1.exr", truth)
    for file in ("0.exr", "1.exr"):
        for channel, values in sorted(read_channels(folder / file)[1].items()):
            print(name, integrator, channel, hashlib.sha256(values.tobytes()).hexdigest())
