"""Light and truth from a CUDA device, against those of LLVM."""

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer, choose_variant, has_cuda_device
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene
from megalopta.scenes.material import Material
from megalopta.scenes.motion import Drift, RigidMotion
from megalopta.scenes.scene import Lighting
from megalopta.scenes.spectra.spectrum import flat

from .conftest import quad, scene_of

pytestmark = [
    pytest.mark.cuda,
    pytest.mark.skipif(
        not has_cuda_device() or choose_variant().name.startswith("scalar"),
        reason="no CUDA device, or no LLVM to compare it with",
    ),
]

CAMERA = PerspectiveCamera(width=96, height=72, fov_deg=70)
PATH = Trajectory(frames=3, position_m=(0, 0, 1.6), look_at_m=(5, 1, 1.5), velocity_m_s=(1, 0.5, 0))


def forest():
    return build_scene(Forest(trees=20, seed=3), Light(level="daylight"), CAMERA, PATH)


def box_before_wall():
    """Meshes at rest and one that moves, of unlike reflectance."""
    wall = quad(np.array([[9, -99, -99], [9, 99, -99], [9, 99, 99], [9, -99, 99.0]]))
    box, ball = trimesh.creation.box((1, 1, 1)), trimesh.creation.icosphere()
    box.apply_translation([5, 1, 1.5])
    ball.apply_translation([6, -1, 1.5])
    motion = RigidMotion((5.0, 1.0, 1.5), Drift(velocity_m_s=(0, -2, 0), spin_deg_s=60))
    things = [(wall, None), (box, motion), (ball, None)]
    return scene_of(
        Lighting(flat(1e-9)),
        *((mesh, Material(flat(0.2 + 0.3 * i)), way) for i, (mesh, way) in enumerate(things)),
    )


def renderers(scene, **settings):
    """Renderer of each backend in turn: the last one that was built sets the variant of all."""
    for backend in ("cuda", "llvm"):
        settings = {**settings, "backend": backend}
        yield SceneRenderer(scene, CAMERA, RenderSettings(**settings), PATH.poses(), 1)


@pytest.mark.parametrize("build", [forest, box_before_wall])
def test_truth_is_that_of_llvm(build):
    cuda, llvm = (
        renderer.truth(PATH.poses(), 1, PATH.times_s)
        for renderer in renderers(build(), samples_per_pixel=1, integrator="path")
    )
    # Rays that graze an edge may go either way.
    same = cuda.object_id == llvm.object_id
    assert same.mean() > 0.999
    assert len(np.unique(llvm.object_id)) > 2
    for name in ("flow_forward", "flow_backward", "depth"):
        here, there = getattr(cuda, name)[same], getattr(llvm, name)[same]
        close = np.isclose(here, there, rtol=1e-4, atol=1e-4, equal_nan=True)
        assert close.mean() > 0.999
    for name in ("occluded_forward", "occluded_backward"):
        assert (getattr(cuda, name) == getattr(llvm, name)).mean() > 0.999
    for name in ("purity", "sky"):
        here, there = getattr(cuda.footprint, name), getattr(llvm.footprint, name)
        assert (np.abs(here - there) < 1e-3).mean() > 0.99
    here, there = cuda.footprint.forward.mean, llvm.footprint.forward.mean
    assert np.nanpercentile(np.abs(here - there), 99) < 1e-3


@pytest.mark.parametrize("integrator", ["path", "baked"])
def test_radiance_is_that_of_llvm(integrator):
    cuda, llvm = (
        renderer.radiance(PATH.poses()[1], 5).sum(axis=-1, dtype=np.float64)
        for renderer in renderers(
            forest(), samples_per_pixel=64, integrator=integrator, bands_nm=((450, 550), (550, 650))
        )
    )
    # Both draw the same random numbers. A ray that grazes an edge may go either way.
    close = np.isclose(cuda, llvm, rtol=1e-3, atol=1e-6 * llvm.mean())
    assert close.mean() > 0.95
    assert cuda.mean() == pytest.approx(llvm.mean(), rel=1e-3)


def test_misses_see_the_sky():
    scene = box_before_wall()
    up = Trajectory(frames=2, position_m=(0, 0, 200), look_at_m=(0, 0, 300), up=(1, 0, 0))
    settings = RenderSettings(backend="cuda", samples_per_pixel=4)
    truth = SceneRenderer(scene, CAMERA, settings).truth(up.poses(), 0, up.times_s)
    assert (truth.object_id == 0).all()
    assert np.isinf(truth.depth).all()
    assert (truth.footprint.sky == 1).all()
