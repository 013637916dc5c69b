"""Radiance against its flow: the next frame, warped back along the forward flow, is this frame."""

import numpy as np
import pytest
import trimesh
from scipy.ndimage import gaussian_filter, map_coordinates

from megalopta.render.scene_renderer import SceneRenderer
from megalopta.render.settings import RenderSettings
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.lighting.light import Light
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.spectra.spectrum import flat
from megalopta.scenes.stimuli.grating import Grating
from megalopta.scenes.trajectories.steady import Trajectory

from ..conftest import quad, scene_of

CAMERA = PerspectiveCamera(width=96, height=72, fov_deg=60)
SETTINGS = RenderSettings(samples_per_pixel=256, bands_nm=((500, 600),), max_depth=2)
TURNING = Trajectory(frames=2, look_at_m=(5, 0, 1.5), rotation_deg_s=20)
# Seen slantwise, so that the flow differs between pixels and has both components.
MOVING = Trajectory(
    frames=2, look_at_m=(5, 1, 0.8), rotation_deg_s=8, velocity_m_s=(1.5, -1.2, 1.6)
)


def textured_wall():
    """A wall x = 5 that glows with noise a few pixels wide, without any symmetry."""
    wall = quad(np.array([[5, 9, -9], [5, -9, -9], [5, -9, 9], [5, 9, 9.0]]))
    wall.visual = trimesh.visual.TextureVisuals(uv=[[0, 0], [1, 0], [1, 1], [0, 1]])
    noise = gaussian_filter(np.random.default_rng(2).normal(size=(512, 512)), 7, mode="wrap")
    pattern = np.maximum(1 + noise / (4 * noise.std()), 0).astype(np.float32)
    return scene_of(None, (wall, Material(flat(0.0), None, Emission(1e-6, pattern))))


def residual(first, second, flow):
    """Difference after warping back, over the spread of the image; both inside of the frame."""
    height, width = first.shape
    x = np.arange(width) + flow[..., 0]
    y = np.arange(height)[:, None] + flow[..., 1]
    inside = (x > 3) & (x < width - 4) & (y > 3) & (y < height - 4)
    assert inside.mean() > 0.6
    warped = map_coordinates(second, [y[inside], x[inside]], order=3)
    return (warped - first[inside]).std() / first.std()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "trajectory"),
    [
        (Grating(cycles_per_frame=3).build(Light(), CAMERA, TURNING), TURNING),
        (textured_wall(), TURNING),
        (textured_wall(), MOVING),
    ],
    ids=["grating, turning", "wall, turning", "wall, moving"],
)
def test_the_next_frame_warped_back_along_the_flow_is_this_frame(scene, trajectory):
    renderer, poses = SceneRenderer(scene, CAMERA, SETTINGS), trajectory.poses()
    first, second = (
        renderer.radiance(pose, seed)[..., 0].astype(np.float64) for seed, pose in enumerate(poses)
    )
    flow = renderer.truth(poses, 0).flow_forward
    # Cubic interpolation of a pattern this smooth leaves less than 0.1 %.
    assert residual(first, second, flow) < 0.01
    for wrong in (-flow, flow * [-1, 1], flow[..., ::-1], 0 * flow):
        assert residual(first, second, wrong) > 0.3
    if trajectory is MOVING:  # turning alone looks the same upside down
        for mirror in (np.s_[:, ::-1], np.s_[::-1]):
            assert residual(first[mirror], second[mirror], flow) > 0.3
