"""Scenes in Mitsuba's XML: shapes and pictures as plain Mitsuba loads them."""

import numpy as np
import pytest
from PIL import Image

from megalopta.render import RenderSettings, SceneRenderer, mi
from megalopta.scenes import Light, Meshes, PerspectiveCamera, Trajectory, build_scene
from megalopta.scenes.spectra.color import BLUE, GREEN, RED, band_means

RNG = np.random.default_rng(3)
PLY_HEADER = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property float s
property float t
element face 2
property list uchar int vertex_indices
end_header
"""
BANDS = ((420, 480), (520, 560), (600, 680))
CAMERA = PerspectiveCamera(width=64, height=48, fov_deg=60)
PATH = Trajectory(frames=2, position_m=(1, -7, 4), look_at_m=(0, 0, 0.6))
SCENE = """<scene version="3.0.0">
  <default name="bright" value="0.6"/>
  <integrator type="path"/>
  <sensor type="perspective"><float name="fov" value="40"/></sensor>
  <emitter type="envmap"><string name="filename" value="missing.exr"/></emitter>
  <bsdf type="twosided" id="painted">
    <bsdf type="diffuse">
      <texture type="bitmap" name="reflectance">
        <string name="filename" value="textures/tiles.png"/>
        <transform name="to_uv"><scale x="2" y="1.5"/></transform>
      </texture>
    </bsdf>
  </bsdf>
  <bsdf type="diffuse" id="red"><rgb name="reflectance" value="$bright, 0.1, 0.2"/></bsdf>
  <shape type="rectangle" id="floor">
    <transform name="to_world"><scale value="4"/></transform>
    <ref id="painted"/>
  </shape>
  <shape type="obj" id="panel">
    <string name="filename" value="panel.obj"/>
    <transform name="to_world">
      <rotate x="1" angle="90"/>
      <translate x="-1.5" y="1" z="1"/>
    </transform>
    <ref id="painted"/>
  </shape>
  <shape type="ply">
    <string name="filename" value="panel.ply"/>
    <transform name="to_world">
      <rotate x="1" angle="105"/><rotate z="1" angle="10"/><translate x="2" y="2" z="1"/>
    </transform>
    <ref id="painted"/>
  </shape>
  <shape type="sphere">
    <point name="center" x="1.5" y="-1" z="0.7"/><float name="radius" value="0.7"/>
    <ref id="red"/>
  </shape>
  <shape type="cylinder">
    <point name="p0" value="-2, -1, 0"/><point name="p1" value="-1, -1, 1.5"/>
    <float name="radius" value="0.3"/>
    <bsdf type="diffuse" id="gray"><spectrum name="reflectance" value="400:0.2, 700:0.5"/></bsdf>
  </shape>
  <shape type="disk">
    <transform name="to_world"><scale value="0.8"/><translate value="0, 0, 2.5"/></transform>
    <emitter type="area"><rgb name="radiance" value="5"/></emitter>
  </shape>
  <shape type="cube">
    <transform name="to_world">
      <scale x="0.2" y="0.3" z="0.4"/><rotate x="0" y="0" z="1" angle="45"/>
      <matrix value="1 0 0 3  0 1 0 0  0 0 1 0.5  0 0 0 1"/>
    </transform>
    <ref id="red"/>
  </shape>
</scene>"""


@pytest.fixture
def xml(tmp_path):
    (tmp_path / "textures").mkdir()
    tiles = RNG.integers(20, 235, (8, 16, 3), dtype=np.uint8)
    Image.fromarray(tiles).save(tmp_path / "textures/tiles.png")
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    uv = np.array([[0, 0], [1, 0.1], [1, 1.1], [0, 1]])
    lines = [
        "mtllib missing.mtl",
        *(f"v {x} {y} {z}" for x, y, z in corners),
        *(f"vt {u} {v}" for u, v in uv),
        "f 1/1 2/2 3/3 4/4",
    ]
    (tmp_path / "panel.obj").write_text("\n".join(lines) + "\n")
    vertices = "".join(
        f"{x} {y} 0 {s} {t}\n" for (x, y, _), (s, t) in zip(corners, uv, strict=True)
    )
    (tmp_path / "panel.ply").write_text(PLY_HEADER + vertices + "3 0 1 2\n3 0 2 3\n")
    path = tmp_path / "scene.xml"
    text = SCENE.replace('value="missing.exr"', f'value="{tmp_path / "sky.exr"}"')
    mi.set_variant("scalar_rgb")
    mi.Bitmap(np.ones((4, 8, 3), np.float32)).write(str(tmp_path / "sky.exr"))
    path.write_text(text)
    return path


def seen_by_mitsuba(path, origin, directions):
    """Distances, and diffuse reflectance in linear sRGB, where plain Mitsuba's rays hit."""
    mi.set_variant("scalar_rgb")
    scene = mi.load_file(str(path))
    distances, colors = [], []
    for direction in directions:
        ray = mi.Ray3f(mi.Point3f(*origin.tolist()), mi.Vector3f(*direction.tolist()))
        hit = scene.ray_intersect(ray)
        distances.append(float(hit.t) if hit.is_valid() else np.inf)
        color = hit.bsdf().eval_diffuse_reflectance(hit) if hit.is_valid() else mi.Color3f(0)
        colors.append(np.array(color))
    return np.array(distances), np.array(colors)


def test_shapes_and_pictures_are_where_plain_mitsuba_has_them(xml):
    pose = PATH.poses()[0]
    directions = CAMERA.directions().reshape(-1, 3) @ pose[:3, :3].T
    distances, colors = seen_by_mitsuba(xml, pose[:3, 3], directions)
    description = Meshes(files=({"file": str(xml), "up": "z"},))
    scene = build_scene(description, Light(), CAMERA, PATH)
    assert scene.kinds == ("cube", "cylinder", "disk", "floor", "panel", "sphere")
    assert len(scene.placements) == 7
    settings = RenderSettings(bands_nm=BANDS, samples_per_pixel=1)
    renderer = SceneRenderer(scene, CAMERA, settings)
    truth = renderer.truth(PATH.poses(), 0)
    found = truth.depth.ravel() / CAMERA.directions()[..., 2].ravel()
    names = np.array(["sky", *scene.kinds])[truth.kind_id.ravel()]
    assert set(names) == {"sky", *scene.kinds}
    # Round shapes have facets, which are up to 1.1e-3 of the radius inside; edges differ.
    is_round = np.isin(names, ["sphere", "cylinder"])
    with np.errstate(invalid="ignore"):
        error = np.where(np.isinf(found) & np.isinf(distances), 0, found - distances)
    assert np.abs(error[~is_round] / found[~is_round] > 1e-5).mean() < 0.01
    assert np.quantile(np.abs(error[is_round]), 0.9) < 2e-3
    # Three bands of a color are a linear map of its red, green and blue.
    weights = np.linalg.inv(band_means((RED, GREEN, BLUE), BANDS))
    ours = renderer.albedo(pose).reshape(-1, 3) @ weights
    same = (np.abs(error) < 1e-4 * found) & np.isin(names, ["floor", "panel", "cube"])
    assert same.mean() > 0.4
    # Mitsuba keeps 8-bit pictures as half floats.
    np.testing.assert_allclose(ours[same], colors[same], atol=2e-3)
