"""Whether light is baked for a sequence."""

import math

from megalopta.core.arrays import Floats
from megalopta.render import RenderSettings
from megalopta.render.baking.shading import MOST_OBJECTS
from megalopta.scenes.scene import Scene

_FEWEST_SAMPLES = 1000
"""Per pixel in a whole sequence. Forests take 4000 rays and more for each pixel of a frame, and
baking pays from 3.4 rays per sample on downward."""
FEWEST_IN_ALL = 10_000_000
"""In all pixels. A look at a sequence takes as long as some millions, however small: it
compiles, cuts the scene into cells and looks from 512 places."""
# In units of a fifth of a path: a ray of the bake, of which each eighth is followed, and a sample
# of a baked frame, of which one in twenty-five is a path. From CPU-seconds of 1000 trees with
# leaves that let light through (benchmarks/bench_baked.py). In single passes a path tracer's frames
# have the RMS error of baked ones with 1.35 times the samples there, with 2.2 times in an open
# forest by day: most noise is of leaves against the sky, in pixels that samples took for surfaces.
# Where samples are many enough to meet an error it takes 5 to 9 times as many, of which the look at
# a few frames takes up a part: its rays are independent, of twice the variance of frames' samples.
PATH, BAKE, SAMPLE, AT_EQUAL_ERROR, _AT_TARGET_ERROR = 5.0, 2.1, 1.3, 1.7, 4.0


def path_tracing_reason(
    scene: Scene,
    variant: str,
    poses: Floats | None,
    settings: RenderSettings,
    pixels: int,
) -> str:
    """Why frames of some pixels are rendered by path tracing; empty where their light is baked.

    Poses (T, 4, 4) are those of the sequence, where it is known.

    Raises
    ------
    ValueError
        Where light is to be baked in haze.
    """
    if scene.haze and settings.integrator == "baked":
        raise ValueError(
            "integrator 'baked': baked light knows surfaces alone, and haze scatters light between "
            "them; use 'auto' or 'path'"
        )
    if settings.integrator == "path":
        return "as asked"
    if scene.haze:
        return "baked light knows no haze"
    if variant.startswith("scalar"):
        return "baking needs a vectorized variant"
    if not scene.placements:
        return "there is no surface to bake light on"
    moving = [placement for placement in scene.placements if placement.motion]
    if len(moving) > MOST_OBJECTS:
        return f"{len(moving)} objects move, and with them light and shadow on all others"
    if len(moving) == len(scene.placements):
        return "there is no surface at rest to bake light on"
    materials = (name for each in moving for name in scene.assets[each.asset].parts)
    if any(scene.materials[name].emission for name in materials):
        return "an object that glows moves, and its light on all others"
    if poses is None:
        return "the camera's path is not known"
    if settings.integrator == "auto" and not may_pay(settings, len(poses), pixels):
        samples = len(poses) * settings.samples_per_pixel
        return (
            f"{samples} samples per pixel in all frames, of {pixels} pixels, are too few to pay "
            "for baking"
        )
    return ""


def may_pay(settings: RenderSettings, frames: int, pixels: int) -> bool:
    """Whether baking may pay for so many frames of so many pixels; a look tells whether it does."""
    passes = settings.max_passes if settings.target_error is not None else 1
    samples = frames * settings.samples_per_pixel * passes
    return samples >= _FEWEST_SAMPLES and samples * pixels >= FEWEST_IN_ALL


def samples_of_pixel(settings: RenderSettings, scatter: float) -> int:
    """Samples of a pixel in a frame, where one is off by `scatter` (RMS, over the mean).

    A target error is met by samples and by baked light together.
    """
    if settings.target_error is None:
        return settings.samples_per_pixel
    left = settings.target_error**2 - settings.standing_error**2
    passes = math.ceil(scatter**2 / left / settings.samples_per_pixel)
    return settings.samples_per_pixel * min(max(passes, 2), settings.max_passes)


def cost_reason(rays: int, samples: int, settings: RenderSettings) -> str:
    """Why a bake of some rays does not pay for frames of some samples; empty where it does.

    It does where frames of the same error on surfaces take less work. Work is counted in rays and
    samples, so that the answer is the same on every machine.
    """
    traced = AT_EQUAL_ERROR * samples
    if settings.target_error:
        # What stands is not for samples to take away.
        standing = settings.standing_error / settings.target_error
        traced = _AT_TARGET_ERROR * samples * (1 - standing**2)
    share = (BAKE * rays + SAMPLE * samples) / (PATH * traced)
    if share <= 1:
        return ""
    return (
        f"baking would take {share:.0%} of the work of path tracing to the same error, for "
        f"{rays / samples:.1f} rays per sample of all frames"
    )
