"""The floor of a rain forest by starlight, from 400 to 1700 nm, twice with independent noise."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from megalopta.core.progress import progress
from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene

FLOOR_BANDS_NM = tuple((float(low), float(low + 100)) for low in range(400, 1700, 100))
FLOOR_LIGHT = Light(level="starlight", sky="natural")
_DEPTH = 12
"""Most bounces but one; leaves absorb little beyond 700 nm, and 8 leave 2 % of the light out."""


@cache
def floor_passes(
    size_px: int = 48, samples: int = 576
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return radiance (H, W, B) of the same view, twice, W·m⁻²·sr⁻¹·nm⁻¹ in `FLOOR_BANDS_NM`."""
    forest = Forest.model_validate({"preset": "rainforest"})
    camera = PerspectiveCamera(width=size_px, height=size_px, fov_deg=60)
    path = Trajectory(frames=2, position_m=(0, 0, 1.5), look_at_m=(6, 0, 0.8))
    settings = RenderSettings(
        samples_per_pixel=samples, max_depth=_DEPTH, bands_nm=FLOOR_BANDS_NM, integrator="path"
    )
    with progress("Rendering the floor of a rain forest", 3, "step") as advance:
        renderer = SceneRenderer(build_scene(forest, FLOOR_LIGHT, camera, path), camera, settings)
        advance()
        passes = []
        for number in range(2):
            passes.append(renderer.radiance(path.poses()[0], frame_seed(0, 0, number)))
            advance()
    return passes[0], passes[1]
