"""Spectral radiance and exact ground truth of a scene; the only folder that imports mitsuba.

renderer = SceneRenderer(scene, camera, RenderSettings())
poses = trajectory.poses()
radiance = renderer.radiance(poses[0], seed=frame_seed(0, 0))
truth = renderer.truth(poses, 0, trajectory.times_s)
far = renderer.flow(poses, 0, 7, trajectory.times_s)
blurred = renderer.exposed(trajectory, Shutter(exposure_s=0.02), 0, seed=0)
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
