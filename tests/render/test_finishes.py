"""Surfaces of Mitsuba's XML that are not diffuse: light as plain Mitsuba's, truth of the first."""

import numpy as np
import pytest
from PIL import Image

from megalopta.render import RenderSettings, SceneRenderer, activate, choose_variant, mi
from megalopta.scenes import Light, Meshes, PerspectiveCamera, Trajectory, build_scene

from .conftest import plainly, vectorized

BANDS = ((420, 480), (520, 560), (600, 680))
CAMERA = PerspectiveCamera(width=32, height=24, fov_deg=75)
INSIDE = Trajectory(frames=2, position_m=(-1.8, 0, 0), look_at_m=(0, 0, -0.1))
SETTINGS = RenderSettings(bands_nm=BANDS, samples_per_pixel=100, max_depth=8, backend="auto")
SEEDS = 12
ROOM = """<scene version="3.0.0">
  <bsdf type="twosided" id="wall">
    <bsdf type="diffuse"><spectrum name="reflectance" value="400:0.3, 720:0.7"/></bsdf>
  </bsdf>
  <bsdf type="diffuse" id="white"><spectrum name="reflectance" value="0.8"/></bsdf>
  <bsdf type="dielectric" id="glass"><string name="int_ior" value="bk7"/></bsdf>
  <bsdf type="twosided" id="gold">
    <bsdf type="roughconductor">
      <string name="material" value="Au"/><float name="alpha" value="0.2"/>
    </bsdf>
  </bsdf>
  <bsdf type="twosided" id="lacquer">
    <bsdf type="roughplastic">
      <texture type="bitmap" name="diffuse_reflectance">
        <string name="filename" value="halves.png"/>
        <transform name="to_uv"><rotate z="1" angle="90"/></transform>
      </texture>
      <float name="alpha" value="0.1"/>
    </bsdf>
  </bsdf>
  <bsdf type="mask" id="cut">
    <texture type="bitmap" name="opacity">
      <string name="filename" value="cut.png"/><boolean name="raw" value="true"/>
    </texture>
    <bsdf type="twosided"><bsdf type="plastic">
      <rgb name="diffuse_reflectance" value="0.1, 0.5, 0.2"/>
    </bsdf></bsdf>
  </bsdf>
  <bsdf type="thindielectric" id="pane"/>
  <bsdf type="twosided" id="paint">
    <bsdf type="principled">
      <rgb name="base_color" value="0.2, 0.3, 0.7"/><float name="metallic" value="0.5"/>
      <float name="roughness" value="0.4"/>
    </bsdf>
  </bsdf>
  <bsdf type="twosided" id="mixed">
    <bsdf type="blendbsdf">
      <float name="weight" value="0.4"/>
      <bsdf type="conductor"><string name="material" value="Cu"/></bsdf>
      <bsdf type="diffuse">
        <texture type="checkerboard" name="reflectance">
          <rgb name="color0" value="0.9, 0.5, 0.1"/><spectrum name="color1" value="0.05"/>
          <transform name="to_uv"><scale x="1" y="3"/></transform>
        </texture>
      </bsdf>
    </bsdf>
  </bsdf>
  <bsdf type="twosided" id="relief">
    <bsdf type="bumpmap">
      <texture type="bitmap">
        <string name="filename" value="bumps.png"/><boolean name="raw" value="true"/>
      </texture>
      <float name="scale" value="3"/>
      <bsdf type="roughplastic"><float name="alpha" value="0.2"/></bsdf>
    </bsdf>
  </bsdf>
  <bsdf type="twosided" id="tiles">
    <bsdf type="normalmap">
      <texture type="bitmap" name="normalmap">
        <string name="filename" value="normals.png"/><boolean name="raw" value="true"/>
      </texture>
      <bsdf type="diffuse"><spectrum name="reflectance" value="0.7"/></bsdf>
    </bsdf>
  </bsdf>
  <shape type="cube" id="room">
    <transform name="to_world"><scale value="2"/></transform><ref id="wall"/>
  </shape>
  <shape type="rectangle" id="lamp">
    <transform name="to_world"><translate z="1.9"/></transform>
    <boolean name="flip_normals" value="true"/>
    <ref id="white"/>
    <emitter type="area"><spectrum name="radiance" value="400:3, 700:6"/></emitter>
  </shape>
  <shape type="sphere" id="marble">
    <point name="center" x="-0.3" y="0.5" z="-0.3"/><float name="radius" value="0.3"/>
    <ref id="glass"/>
  </shape>
  <shape type="cube" id="ingot">
    <transform name="to_world">
      <scale value="0.3"/><rotate z="1" angle="30"/><translate x="0.4" y="-0.6" z="-0.6"/>
    </transform>
    <ref id="gold"/>
  </shape>
  <shape type="sphere" id="ball">
    <point name="center" x="0.8" y="0.7" z="-0.9"/><float name="radius" value="0.4"/>
    <ref id="paint"/>
  </shape>
  %s
</scene>"""
PANEL = """<shape type="rectangle" id="{}">
    <transform name="to_world">
      <rotate y="1" angle="{}"/><scale value="{}"/><translate x="{}" y="{}" z="{}"/>
    </transform>
    <ref id="{}"/>
  </shape>"""
PANELS = (
    ("picture", -90, 0.9, 1.9, -0.6, 0.3, "lacquer"),
    ("leaf", -80, 0.4, 0.5, 1.2, 0.5, "cut"),
    ("window", -70, 0.3, 0, -0.4, 0.5, "pane"),
    ("panel", -80, 0.4, 1.2, -1.3, -0.9, "relief"),
    ("tiling", -80, 0.4, 1.2, 1.3, -0.9, "tiles"),
    ("coin", -60, 0.4, 1, 0.2, 1, "mixed"),
)


@pytest.fixture
def room(tmp_path):
    halves = np.full((8, 8, 3), 230, np.uint8)
    halves[:4] = 30, 60, 20
    halves[:, :2] = 200, 20, 20
    Image.fromarray(halves).save(tmp_path / "halves.png")
    cut = np.full((16, 16), 255, np.uint8)
    cut[4:] = 0
    Image.fromarray(cut).save(tmp_path / "cut.png")
    bumps = 128 + 120 * np.sin(np.arange(32)[:, None] / 3) * np.cos(np.arange(32) / 2)
    Image.fromarray(bumps.astype(np.uint8)).save(tmp_path / "bumps.png")
    normals = np.full((8, 8, 3), (128, 128, 255), np.uint8)
    normals[:, :6] = 20, 128, 190
    Image.fromarray(normals).save(tmp_path / "normals.png")
    path = tmp_path / "room.xml"
    path.write_text(ROOM % "".join(PANEL.format(*each) for each in PANELS))
    return path


def built(path, lights="file", **more):
    files = {"file": str(path), "up": "z"}
    return build_scene(Meshes(files=(files,), lights=lights, **more), Light(), CAMERA, INSIDE)


def blocks(radiance):
    """Mean radiance (SEEDS, 4, 4, B) of blocks of the picture, by seed."""
    found = np.array([np.asarray(radiance(seed), np.float64) for seed in range(SEEDS)])
    return found.reshape(SEEDS, 4, 6, 4, 8, -1).mean(axis=(2, 4))


@vectorized
@pytest.mark.slow
def test_metal_glass_and_gloss_are_as_bright_as_in_plain_mitsuba(room):
    scene, pose = built(room), INSIDE.poses()[0]
    renderer = SceneRenderer(scene, CAMERA, SETTINGS, INSIDE.poses())
    assert renderer.integrator == "path (baked light covers diffuse surfaces only)"
    ours = blocks(lambda seed: renderer.radiance(pose, seed))
    activate(choose_variant("auto"))
    plain = plainly(mi.load_file(str(room)), CAMERA, pose, SETTINGS)
    theirs = blocks(lambda seed: plain(seed + 100))
    # With 22 degrees of freedom, one of 48 exceeds 10 with a probability of 6e-8, and one of 3
    # exceeds 8 with 2e-7; errors of the whole picture are below half a percent.
    pictures = ours.mean((1, 2)), theirs.mean((1, 2))
    for (a, b), most in (((ours, theirs), 10), (pictures, 8)):
        error = np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / SEEDS)
        assert np.abs((a.mean(axis=0) - b.mean(axis=0)) / error).max() < most
    assert (error < 0.005 * ours.mean(axis=(0, 1, 2))).all()


@vectorized
def test_truth_is_that_of_glass_and_of_the_whole_of_a_cut_out(room):
    renderer = SceneRenderer(built(room), CAMERA, SETTINGS, INSIDE.poses())
    truth = renderer.truth(INSIDE.poses(), 0)
    names = np.array(["sky", *built(room).kinds])[truth.kind_id]
    assert {"marble", "window", "leaf"} <= set(names.ravel())
    pose = INSIDE.poses()[0]
    positions = truth.position[names == "marble"].astype(np.float64)
    from_center = np.linalg.norm(positions - [-0.3, 0.5, -0.3], axis=-1)
    np.testing.assert_allclose(from_center, 0.3, atol=3.3e-4)  # facets, 1.1e-3 of the radius
    assert not renderer.albedo(pose)[names == "marble"].any()
    assert renderer.albedo(pose)[names == "room"].min() > 0.3
