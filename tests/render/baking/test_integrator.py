"""Baked light against closed forms and against the path tracer."""

import dataclasses
import math
from functools import partial

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.render.baking import cells, light as bake
from megalopta.render.baking.cells import views
from megalopta.render.baking.choice import cost_reason, path_tracing_reason
from megalopta.scenes import PerspectiveCamera, Trajectory
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.motion import Drift, RigidMotion
from megalopta.scenes.scene import Lighting, Sun
from megalopta.scenes.spectra.spectrum import Spectrum, flat

from ..conftest import band_means, down, quad, scene_of, square, vectorized

CAMERA = PerspectiveCamera(width=24, height=24, fov_deg=40)
# Five bands need two groups of Mitsuba's four wavelengths.
BANDS = ((400.0, 450.0), (450.0, 500.0), (500.0, 600.0), (600.0, 700.0), (900.0, 1000.0))
SKY = Spectrum((300.0, 500.0, 700.0, 1100.0), (1e-9, 2e-9, 4e-9, 4e-9))
LEAF = Spectrum((400.0, 550.0, 700.0, 750.0, 1000.0), (0.05, 0.12, 0.06, 0.5, 0.5))
SUN_DIRECTION = (math.sin(1.0), 0.0, math.cos(1.0))
DOWN = down()


def renderer_of(scene, poses, seed=0, camera=CAMERA, **settings):
    settings = RenderSettings(**{"samples_per_pixel": 4, "integrator": "baked", **settings})
    return SceneRenderer(scene, camera, settings, poses, seed)


@vectorized
@pytest.mark.parametrize(
    ("light", "share"),
    [(Lighting(SKY), 1.0), (Lighting(flat(0.0), Sun(SUN_DIRECTION, SKY)), math.cos(1.0) / math.pi)],
    ids=["sky", "sun"],
)
def test_plane_shows_the_band_mean_of_reflectance_times_irradiance_over_pi(light, share, ground):
    scene = scene_of(light, (ground, Material(LEAF)))
    image = renderer_of(scene, DOWN, bands_nm=BANDS).radiance(DOWN[0], 1)
    expected = band_means(BANDS, LEAF, SKY) * share
    # Every ray meets the same sky.
    np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), 1e-4)


@pytest.mark.slow
@vectorized
def test_what_lies_below_the_ground_sends_no_light_up():
    # Of a wall 3 cm look out of the ground, and cells are 8 cm high. Below, half of the sky is
    # seen; above there is a roof, and only what comes in from far away.
    wall = quad(np.array([[0, -1, -0.37], [0, 1, -0.37], [0, 1, 0.03], [0, -1, 0.03]], float))
    black, white = Material(flat(0)), Material(flat(0.5))
    scene = scene_of(
        Lighting(flat(1e-9)), (square(0, 20), black), (square(0.8, 20), black), (wall, white)
    )
    poses = Trajectory(frames=2, position_m=(-6, 0.2, 0.6), look_at_m=(0, 0, 0)).poses()
    common = {"samples_per_pixel": 1024, "bands_nm": BANDS[:1], "max_depth": 2}
    renderers = (renderer_of(scene, poses, integrator=name, **common) for name in ("path", "baked"))
    # above the tenth row is the sky under the roof
    path, baked = (
        np.mean([each.radiance(poses[0], seed)[10:].sum() for seed in range(12)])
        for each in renderers
    )
    # five standard errors of paths; all of the cell's light is twelve times as much
    assert baked == pytest.approx(path, rel=0.25)


def thicket(lighting, *more):
    """Leaves in front of a textured trunk with smooth normals on sloping ground."""
    rng = np.random.default_rng(5)
    corners = rng.uniform([-1.5, -1.5, 0.2], [1.5, 1.5, 2.5], (150, 1, 3))
    corners = corners + 0.25 * rng.normal(size=(150, 3, 3))
    leaves = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(450).reshape(-1, 3), process=False)
    trunk = trimesh.creation.cylinder(0.25, 3, sections=10)
    trunk.apply_translation([0, 0, 1.5])
    trunk.metadata["smooth"] = True
    trunk.visual = trimesh.visual.TextureVisuals(uv=trunk.vertices[:, 1:])
    weight = rng.random((16, 16)).astype(np.float32)
    bark = Material(flat(0.1), Texture(weight, Spectrum((400.0, 700.0), (0.3, 0.7))))
    ground = trimesh.Trimesh([[-4, -4, 0], [4, -4, 0.5], [4, 4, 0], [-4, 4, -0.5]])
    ground = trimesh.Trimesh(ground.vertices, [[0, 1, 2], [0, 2, 3]], process=False)
    return scene_of(
        lighting,
        (leaves, Material(LEAF, transmittance=LEAF)),
        (trunk, bark),
        (ground, Material(flat(0.3))),
        *more,
    )


ORBIT = Trajectory(frames=4, position_m=(4, 0, 1.5), look_at_m=(0, 0, 1), rotation_deg_s=10).poses()


def compared(tracer, light, seeds, time=0.0):
    """Frames (seeds, H, W) of both, and squares (H, W) of what stands.

    That is the mean difference, less the noise of both that is left in it. The same seed sends the
    same primary rays, so edges are sampled alike in both.
    """
    paths, quick = (
        np.array([each.radiance(ORBIT[1], seed, time).sum(axis=-1) for seed in range(seeds)], float)
        for each in (tracer, light)
    )
    noise = (quick - paths).var(axis=0, ddof=1) / seeds
    return paths, quick, (quick - paths).mean(axis=0) ** 2 - noise


@pytest.mark.slow
@vectorized
def test_frames_do_not_depend_on_which_were_rendered_before_nor_on_batches(monkeypatch):
    scene = thicket(Lighting(SKY, Sun(SUN_DIRECTION, flat(2e-8))))
    frames = [
        renderer.radiance(ORBIT[3], 7) for renderer in [renderer_of(scene, ORBIT, bake_error=0.3)]
    ]
    resumed = renderer_of(scene, ORBIT, bake_error=0.3)
    for frame in (0, 2):
        resumed.radiance(ORBIT[frame], frame)
    frames.append(resumed.radiance(ORBIT[3], 7))
    monkeypatch.setattr(bake, "RAYS_AT_ONCE", 10_000)
    monkeypatch.setattr(cells, "HITS_AT_ONCE", 10_000)
    frames.append(renderer_of(scene, ORBIT, bake_error=0.3).radiance(ORBIT[3], 7))
    assert frames[0].tobytes() == frames[1].tobytes() == frames[2].tobytes()
    other = renderer_of(scene, ORBIT, seed=1, bake_error=0.3).radiance(ORBIT[3], 7)
    assert frames[0].tobytes() != other.tobytes()


def test_paths_are_traced_where_baking_is_not_asked_for_or_cannot_pay(ground):
    settings = RenderSettings(samples_per_pixel=25)

    def reason(scene, variant="llvm_ad_spectral", frames=400, integrator="auto", pixels=80**2):
        chosen = settings.model_copy(update={"integrator": integrator})
        return path_tracing_reason(scene, variant, np.zeros((frames, 4, 4)), chosen, pixels)

    still = scene_of(Lighting(SKY), ground)
    assert reason(still) == ""
    assert reason(still, frames=4, integrator="baked") == ""
    assert reason(still, integrator="path") == "as asked"
    assert "100 samples per pixel in all frames, of 6400 pixels, are too few" in reason(
        still, frames=4
    )
    # 10,000 samples of each: the look alone would take longer
    assert "too few" in reason(still, pixels=24**2)
    # 25 samples and baked light have an error of 10.2 %, for which paths would take 2384 samples:
    # 0.6 r + 0.6 · 25 = 1.5 · 2384 for each pixel.
    cost = partial(cost_reason, pixels=1, baked=0.5, traced=37.5, settings=settings)
    assert cost(5934) == ""
    assert "100% of the work of path tracing to the same error of 10.2%" in cost(5937)
    assert "vectorized" in reason(still, "scalar_spectral", integrator="baked")
    assert "no surface" in reason(dataclasses.replace(still, placements=()))


def least_standing(tracer, light, part, time=0.0):
    """Standing error of a part of the image, relative to its light, less five standard errors."""
    paths, _, squares = compared(tracer, light, 6, time)
    squares = squares[part]
    error = 5 * squares.std() / math.sqrt(squares.size)
    return math.sqrt(max(squares.mean() - error, 0)) / paths.mean(axis=0)[part].mean()


@pytest.mark.slow
@vectorized
def test_paths_are_traced_of_what_the_survey_did_not_meet(monkeypatch):
    def few(camera, poses, count, seed):
        return views(camera, poses, 1, seed, step=2)

    monkeypatch.setattr("megalopta.render.baking.integrator.views", few)
    common = {"samples_per_pixel": 64, "max_depth": 3, "bands_nm": BANDS[:1], "bake_error": 0.05}
    scene = thicket(Lighting(SKY, Sun(SUN_DIRECTION, flat(2e-8))))
    tracer, light = (
        renderer_of(scene, ORBIT, integrator=name, **common) for name in ("path", "baked")
    )
    part = light.measured(ORBIT[1], 0)
    # Without their light surfaces would be half as bright.
    assert least_standing(tracer, light, part.sky == 0) < 1.25 * 0.05
    assert (part.standing[part.sky == 0] == 0).mean() > 0.1


@pytest.mark.slow
@vectorized
def test_a_moving_box_leaves_the_rest_baked():
    box = trimesh.creation.box((0.2, 0.2, 0.2))
    box.apply_translation([1.5, 0.0, 1.5])
    motion = RigidMotion((1.5, 0.0, 1.5), Drift(velocity_m_s=(0.0, 1.0, 0.0)))
    scene = thicket(Lighting(SKY), (box, Material(flat(0.4)), motion))

    common = {"samples_per_pixel": 64, "max_depth": 3, "bands_nm": BANDS[:1]}
    tracer, light = (
        renderer_of(scene, ORBIT, integrator=name, bake_error=0.05, **common)
        for name in ("path", "baked")
    )
    assert light.integrator == "baked"
    part = light.measured(ORBIT[1], 0, 0.4)
    assert least_standing(tracer, light, part.sky == 0, 0.4) < 1.25 * 0.05
    # The box itself is there, and its paths are traced.
    assert 0 < np.mean((part.standing == 0).all(axis=(2, 3)) & (part.sky == 0)) < 0.5
