"""Choice of baked light or path tracing for a sequence."""

import math
from typing import NamedTuple

from megalopta.core.arrays import Floats
from megalopta.render import RenderSettings
from megalopta.render.baking.neighborhood import MOST_OBJECTS
from megalopta.scenes.scene import Scene

_FEWEST_SAMPLES = 1000
"""Fewest samples per pixel in a whole sequence: forests take some thousand rays per pixel of a
frame."""
FEWEST_IN_ALL = 10_000_000
"""Fewest samples in all pixels. A survey takes as long as some millions of samples, for any size:
it compiles, divides the scene into cells and looks from 512 places."""
PATH, WHOLE_PATH, BAKE, SAMPLE = 1.5, 4.0, 1.7, 0.7
"""Work in CPU-µs: of a sample of split paths, of a path that is not split, of a ray of the bake,
and of a sample of a baked frame, in a dense forest (`benchmarks/bench_light.py`)."""


class Scatter(NamedTuple):
    """RMS error of one sample over the mean, on surfaces."""

    baked: float
    """Error of baked light: of the sun, and of the pixel's content."""
    traced: float
    """Error of split paths; NaN where the light cannot be split."""


def path_tracing_reason(
    scene: Scene,
    variant: str,
    poses: Floats | None,
    settings: RenderSettings,
    pixels: int,
) -> str:
    """Reason for rendering frames by path tracing; empty if their light is baked.

    `poses` (T, 4, 4) are those of the sequence, if known.

    Raises ValueError if light is to be baked in haze, or on surfaces that are not diffuse.
    """
    if scene.haze and settings.integrator == "baked":
        raise ValueError(
            "integrator 'baked': baked light covers surfaces only, but haze scatters light between "
            "them; use 'auto' or 'path'"
        )
    shiny = sorted(name for name, material in scene.materials.items() if material.finish)
    if shiny and settings.integrator == "baked":
        raise ValueError(
            "integrator 'baked': baked light covers diffuse surfaces and black lamps only, and "
            f"material {shiny[0]!r} is another; use 'auto' or 'path'"
        )
    if settings.integrator == "path":
        return "as asked"
    if any(not scene.materials[name].emission for name in shiny):
        return "baked light covers diffuse surfaces only"
    if scene.haze:
        return "baked light does not support haze"
    if variant.startswith("scalar"):
        return "baking needs a vectorized variant"
    if not scene.placements:
        return "there is no surface for baked light"
    moving = [placement for placement in scene.placements if placement.motion]
    if len(moving) > MOST_OBJECTS:
        return f"{len(moving)} objects move and change light and shadow on all others"
    if len(moving) == len(scene.placements):
        return "there is no surface at rest for baked light"
    materials = (name for each in moving for name in scene.assets[each.asset].parts)
    if any(scene.materials[name].emission for name in materials):
        return "a glowing object moves, and with it its light on all others"
    glowing = any(material.emission for material in scene.materials.values())
    if settings.integrator == "auto" and glowing:
        return "surfaces glow; 'auto' bakes only the light of sun and sky"
    if settings.integrator == "auto" and scene.lighting is None:
        return "no sun or sky lights the scene"
    if poses is None:
        return "the camera's path is unknown"
    if settings.integrator == "auto" and not may_pay(settings, len(poses), pixels):
        samples = len(poses) * settings.samples_per_pixel
        return (
            f"{samples} samples per pixel in all frames, of {pixels} pixels, are too few for "
            "baking to pay"
        )
    return ""


def may_pay(settings: RenderSettings, frames: int, pixels: int) -> bool:
    """True if baking may pay for these frames and pixels; a survey decides."""
    passes = settings.max_passes if settings.target_error is not None else 1
    samples = frames * settings.samples_per_pixel * passes
    return samples >= _FEWEST_SAMPLES and samples * pixels >= FEWEST_IN_ALL


def samples_of_pixel(settings: RenderSettings, scatter: Scatter) -> int:
    """Samples per pixel and frame that reach the target error together with baked light."""
    if settings.target_error is None:
        return settings.samples_per_pixel
    left = settings.target_error**2 - settings.standing_error**2
    passes = math.ceil(scatter.baked**2 / left / settings.samples_per_pixel)
    return settings.samples_per_pixel * min(max(passes, 2), settings.max_passes)


def cost_reason(rays: int, pixels: int, scatter: Scatter, settings: RenderSettings) -> str:
    """Reason that baking with some rays does not pay; empty if it pays.

    `pixels` are those of all frames together. It pays if frames of the same error on surfaces take
    less work. Work is counted in rays and samples, so that the result is the same on every machine.
    """
    if not scatter.traced:
        return "no surface in view is lit"
    samples = samples_of_pixel(settings, scatter)
    error2 = scatter.baked**2 / samples + settings.standing_error**2
    share = (BAKE * rays / pixels + SAMPLE * samples) / (PATH * scatter.traced**2 / error2)
    if share <= 1:
        return ""
    return (
        f"baking would take {share:.0%} of the work of path tracing to the same error of "
        f"{math.sqrt(error2):.1%} on surfaces"
    )
