"""Choice of baked light or path tracing for a sequence, by the error of baked light.

It is predicted from a few frames, then measured against traced paths from the same points.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render import RenderSettings, dr, mi
from megalopta.render.baking.cells import views
from megalopta.render.film import pixel_means
from megalopta.render.noise import pairs
from megalopta.render.path_tracing import Part
from megalopta.render.settings import part_seed
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.scene import Scene

MOST_OBJECTS = 16
"""Number of objects among which each point searches the nearest."""
_FEWEST_SAMPLES = 1000
"""Fewest samples per pixel in a whole sequence: forests take some thousand rays per pixel of a
frame."""
FEWEST_IN_ALL = 10_000_000
"""Fewest samples in all pixels. A survey takes as long as some millions of samples, for any size:
it compiles, divides the scene into cells and looks from 512 places."""
WHOLE_PATH, BAKE, SAMPLE = 4.0, 0.6, 0.6
"""Work in CPU-µs: of a path that is not split, of a ray of the bake, and of a sample of a baked
frame, in a dense forest (`benchmarks/bench_light.py`)."""


def path_tracing_reason(
    scene: Scene, variant: str, poses: Floats | None, settings: RenderSettings, pixels: int
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
    if scene.lamps and settings.integrator == "baked":
        raise ValueError(
            "integrator 'baked': baked light is that of sun, sky and surfaces, and the scene has "
            "lamps without size; use 'auto' or 'path'"
        )
    if settings.integrator in ("path", "plain"):
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
    materials = (name for thing in moving for name in scene.assets[thing.asset].parts)
    if any(scene.materials[name].emission for name in materials):
        return "a glowing object moves, and with it its light on all others"
    glowing = any(material.emission for material in scene.materials.values())
    if settings.integrator == "auto" and glowing:
        return "surfaces glow; 'auto' bakes only the light of sun and sky"
    if settings.integrator == "auto" and (scene.lighting is None or scene.lamps):
        return "the scene is not lit by sun and sky alone"
    if poses is None:
        return "the camera's path is unknown"
    samples = len(poses) * settings.samples_per_pixel
    most = len(poses) * settings.most_samples
    is_few = most < _FEWEST_SAMPLES or most * pixels < FEWEST_IN_ALL
    if settings.integrator == "auto" and is_few:
        return (
            f"{samples} samples per pixel in all frames, of {pixels} pixels, are too few for "
            "baking to pay"
        )
    return ""


def cost_reason(
    rays: int, pixels: int, baked: float, traced: float, settings: RenderSettings
) -> str:
    """Reason that baking with some rays does not pay; empty if it pays.

    `baked` is the RMS error of one sample of baked light over the mean, on surfaces; `traced` the
    work of split paths for a pixel of an RMS error of 1, NaN where the light cannot be split.

    `pixels` are those of all frames together. It pays if frames of the same error on surfaces take
    less work. Work is counted in rays and samples, so that the result is the same on every machine.
    """
    if not traced:
        return "no surface in view is lit"
    samples = settings.samples_per_pixel
    if settings.target_error is not None:
        left = settings.target_error**2 - settings.standing_error**2
        passes = math.ceil(baked**2 / left / samples)
        samples *= min(max(passes, 2), settings.max_passes)
    error2 = baked**2 / samples + settings.standing_error**2
    share = (BAKE * rays / pixels + SAMPLE * samples) / (traced / error2)
    if share <= 1:
        return ""
    return (
        f"baking would take {share:.0%} of the work of path tracing to the same error of "
        f"{math.sqrt(error2):.1%} on surfaces"
    )


_RAYS = 32
"""Rays per pixel and frame."""


def pilot_views(camera: Camera, poses: Floats, seed: int) -> list[list[Any]]:
    """Views, as from `views`, of a few frames of a camera at poses (T, 4, 4)."""
    step = max(camera.width * camera.height // 2000, 1)  # about 2000 pixels per frame
    frames = poses[np.linspace(0, len(poses) - 1, 3).round().astype(int)]
    return [list(views(camera, pose[None], _RAYS, seed, step)) for pose in frames]


class Pilot(NamedTuple):
    """Light of pixels that show only surfaces, from `_RAYS` rays each, as sums over bands."""

    mean: float
    standing: float
    """Mean square of the fixed error of a pixel."""
    variance: float
    """Mean variance of one ray of a pixel."""


def pilot(frames: list[list[Any]], look: Callable[[Any], list[Any]]) -> Pilot:
    """Light of a few frames, given a function of the rays of one.

    `look` returns the light of each band, a draw of its error for each, and whether it is the sky.
    All rays of a frame are traced at once, as each launch has a fixed cost.
    """
    pixels = []
    for frame in frames:
        both = [np.broadcast_arrays(np.array(rays.o), np.array(rays.d)) for rays in frame]
        origins, directions = (np.concatenate(parts, axis=1) for parts in zip(*both, strict=True))
        values = look(mi.Ray3f(mi.Point3f(origins), mi.Vector3f(directions)))
        bands = len(values) // 2
        total: Any = sum(values[:bands])
        quantities = total, dr.square(total), sum(values[bands:-1]), values[-1]
        dr.eval(quantities)
        rays = np.array([np.array(quantity) for quantity in quantities])
        halves = rays.reshape(4, 2, _RAYS // 2, -1).mean(axis=2, dtype=np.float64)
        means = halves.mean(axis=1)
        # A pixel shows many clusters of cells, and each ray the error of one: the square of the
        # mean error of some rays is too large, the product of two halves' is right.
        means[2] = halves[2].prod(axis=0)
        pixels.append(means)
    light, square, standing, sky = np.concatenate(pixels, axis=1)
    surface = sky == 0
    if not surface.any():
        return Pilot(0.0, 0.0, 0.0)
    variance = (square - light**2)[surface].mean() * _RAYS / (_RAYS - 1)
    fixed = max(standing[surface].mean(), 0.0)
    return Pilot(light[surface].mean(), fixed, max(variance, 0.0))


def work_of_paths(parts: Sequence[Part], frames: list[list[Any]], sampler: Any) -> float:
    """CPU-µs of split paths for a pixel that shows only surfaces, with an RMS error of its mean."""
    light = variance = 0.0
    for part in parts:

        def look(rays: Any, part: Part = part) -> list[Any]:
            *bands, sky = part.look(rays, mi.Float(0.5), sampler)
            return [*bands, *[dr.zeros(mi.Float, dr.width(sky))] * len(bands), sky]

        of_part = pilot(frames, look)
        light += of_part.mean
        variance += of_part.variance / part.share
    work = sum(part.share * part.cost for part in parts)
    return work * variance / max(light, 1e-300) ** 2


GROUPS = 8
GROUP = 64
"""Paths per pixel and group."""
SHARE_TO_COMPARE = 0.03
"""Share of a sequence's work spent on comparing."""
FEWEST_TO_COMPARE = 128
"""Fewest pixels of a measured frame that are compared."""

Differences = Callable[[Any, Any, Any], list[Any]]
"""Baked light minus that of paths in each band, from the arguments of a `Look`."""


def compared(
    sensor: Any, seed: int, image: NDArray[np.float32], share: float, look: Differences
) -> NDArray[np.float32]:
    """Differences (H, W, GROUPS·B) at a share of the pixels, NaN elsewhere.

    Pixels are in pairs of neighbors without sky, whose share is the last channel of the image (H,
    W, 2·B + 1).
    """
    sky, bands = image[..., -1], image.shape[-1] // 2
    differences = np.full((sky.size, GROUPS * bands), np.nan, np.float32)
    part, most = sky <= 0, round(share * sky.size / 2)
    number = np.arange(part.size).reshape(part.shape)
    columns, rows = pairs(part)
    both = np.concatenate(
        [
            np.stack([number[:-1][columns], number[1:][columns]], axis=1),
            np.stack([number[:, :-1][rows], number[:, 1:][rows]], axis=1),
        ]
    )
    # The same in all passes of a strip, which are averaged.
    order = np.random.default_rng(0).permutation(len(both))[:most]
    chosen = np.unique(both[order])
    if len(chosen):
        # Each pixel once per group, with its own samples.
        several = np.tile(chosen, GROUPS)
        sampler = mi.load_dict({"type": "multijitter", "sample_count": GROUP})
        means = pixel_means(sensor, sampler, part_seed(seed, "comparison"), look, several)
        groups = means.reshape(GROUPS, len(chosen), bands)
        differences[chosen] = groups.transpose(1, 0, 2).reshape(len(chosen), -1)
    return differences.reshape(*sky.shape, -1)
