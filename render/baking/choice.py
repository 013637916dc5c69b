"""Whether light is baked for a sequence."""

import numpy as np
from numpy.typing import NDArray

from megalopta.render import RenderSettings
from megalopta.render.baking.moving import MOST_OBJECTS
from megalopta.scenes.world import Scene

# Samples per pixel in a whole sequence from which on baking pays.
_PAYS_FROM = 256


def path_tracing_reason(
    scene: Scene, variant: str, poses: NDArray[np.float64] | None, settings: RenderSettings
) -> str:
    """Why frames are rendered by path tracing; empty where their light is baked.

    Poses (T, 4, 4) are those of the sequence, where it is known.
    """
    if settings.integrator == "path":
        return "as asked"
    if variant.startswith("scalar"):
        return "baking needs a vectorized variant"
    if not scene.placements:
        return "there is no surface to bake light on"
    moving = sum(placement.motion is not None for placement in scene.placements)
    if moving > MOST_OBJECTS:
        return f"{moving} objects move, and with them light and shadow on all others"
    if moving == len(scene.placements):
        return "there is no surface at rest to bake light on"
    if poses is None:
        return "the camera's path is not known"
    samples = len(poses) * settings.samples_per_pixel
    if settings.integrator == "auto" and samples < _PAYS_FROM:
        return f"{samples} samples per pixel in all frames are too few to pay for baking"
    return ""
