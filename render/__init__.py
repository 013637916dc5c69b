"""Scene data to spectral radiance and exact ground truth; the only folder that imports mitsuba.

renderer = SceneRenderer(scene, camera, RenderSettings())
poses = trajectory.poses()
radiance = renderer.radiance(poses[0], seed=frame_seed(0, 0))
truth = renderer.truth(poses, 0, trajectory.times_s)
far = renderer.flow(poses, 0, 7, trajectory.times_s)
blurred = renderer.exposed(trajectory, Shutter(exposure_s=0.02), 0, seed=0)
"""

from megalopta.render import silence  # noqa: F401  # before all that loads Dr.Jit
from megalopta.render.exr import (
    read_attributes,
    read_radiance,
    read_truth,
    write_radiance,
    write_truth,
)
from megalopta.render.renderer import SceneRenderer
from megalopta.render.settings import RenderSettings, frame_seed
from megalopta.render.truth import Flow, Truth, out_of_view
from megalopta.render.variant import Variant, choose_variant

__all__ = [
    "Flow",
    "RenderSettings",
    "SceneRenderer",
    "Truth",
    "Variant",
    "choose_variant",
    "frame_seed",
    "out_of_view",
    "read_attributes",
    "read_radiance",
    "read_truth",
    "write_radiance",
    "write_truth",
]
