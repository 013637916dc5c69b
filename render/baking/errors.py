"""Error of baked light: predicted from a few frames, then measured against traced paths.

Both use the same points of some pixels, so that the pixels' content cancels. The paths of a pixel
come in independent groups, which gives their own scatter (`render.noise`). Many paths per pixel are
used rather than many pixels: the scatter to be subtracted decreases with their number.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.render import MEASURED_EVERY, dr, mi
from megalopta.render.baking.choice import SAMPLE, WHOLE_PATH
from megalopta.render.baking.visibility import views
from megalopta.render.noise import pairs
from megalopta.render.sensors.primary import pixel_means
from megalopta.render.settings import part_seed
from megalopta.render.split_paths import Part
from megalopta.scenes.cameras.base import Camera

_FRAMES = 3
_RAYS = 32
"""Rays per pixel and frame."""
_PIXELS = 2000
"""Approximate number of pixels per frame; all pixels of small frames."""


def pilot_views(camera: Camera, poses: Floats, seed: int) -> list[list[Any]]:
    """Views, as from `views`, of a few frames of a camera at poses (T, 4, 4)."""
    step = max(camera.width * camera.height // _PIXELS, 1)
    frames = poses[np.linspace(0, len(poses) - 1, _FRAMES).round().astype(int)]
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
    found = np.concatenate([_of_pixels(frame, look) for frame in frames], axis=1)
    light, square, standing, sky = found
    surface = sky == 0
    if not surface.any():
        return Pilot(0.0, 0.0, 0.0)
    variance = (square - light**2)[surface].mean() * _RAYS / (_RAYS - 1)
    fixed = max(standing[surface].mean(), 0.0)
    return Pilot(light[surface].mean(), fixed, max(variance, 0.0))


def scatter_of_paths(parts: Sequence[Part], frames: list[list[Any]], sampler: Any) -> float:
    """RMS error of one sample of split paths over the mean, of pixels that show only surfaces."""

    def found(part: Part) -> Pilot:
        def look(rays: Any) -> list[Any]:
            *light, sky = part.look(rays, mi.Float(0.5), sampler)
            return [*light, *[dr.zeros(mi.Float, dr.width(sky))] * len(light), sky]

        return pilot(frames, look)

    pilots = [(part.every, found(part)) for part in parts]
    light = sum(each.mean for _, each in pilots)
    return math.sqrt(sum(every * each.variance for every, each in pilots)) / max(light, 1e-300)


def _of_pixels(frame: list[Any], look: Callable[[Any], list[Any]]) -> Floats:
    """Means over the rays of each pixel: light, its square, squared error and sky (4, P).

    A pixel shows many clusters of cells, and each ray the error of one. So the square of the mean
    error of some rays is too large. The product of those of two halves of the rays is right.
    """
    directions = np.concatenate([np.array(rays.d) for rays in frame], axis=1)
    found = look(mi.Ray3f(frame[0].o, mi.Vector3f(directions)))
    bands = len(found) // 2
    total: Any = sum(found[:bands])
    parts = total, dr.square(total), sum(found[bands:-1]), found[-1]
    dr.eval(parts)
    seen = np.array([np.array(each) for each in parts]).reshape(4, 2, _RAYS // 2, -1)
    halves = seen.mean(axis=2, dtype=np.float64)
    means = halves.mean(axis=1)
    means[2] = halves[2].prod(axis=0)
    return np.asarray(means)


GROUPS = 8
GROUP = 64
"""Paths per pixel and group."""
_SHARE = 0.03
"""Share of a sequence's work spent on comparing."""
_FEWEST = 128

Differences = Callable[[Any, Any, Any], list[Any]]
"""Baked light minus that of paths in each band, from the arguments of a `Look`."""


def pixels_to_compare(work: float, frames: int) -> int:
    """Number of pixels to compare per measured frame, for the work of all frames."""
    measured = -(-frames // MEASURED_EVERY)
    paths = _SHARE * work / (WHOLE_PATH + SAMPLE) / measured
    return max(int(paths / (GROUPS * GROUP)), _FEWEST)


def compared(
    sensor: Any, seed: int, image: NDArray[np.float32], share: float, look: Differences
) -> NDArray[np.float32]:
    """Differences (H, W, GROUPS·B) at a share of the pixels, NaN elsewhere.

    Pixels are in pairs of neighbors without sky, whose share is the last channel of the image (H,
    W, 2·B + 1).
    """
    sky, bands = image[..., -1], image.shape[-1] // 2
    found = np.full((sky.size, GROUPS * bands), np.nan, np.float32)
    chosen = _pairs(sky <= 0, round(share * sky.size / 2))
    if len(chosen):
        # Each pixel once per group, with its own samples.
        several = np.tile(chosen, GROUPS)
        sampler = mi.load_dict({"type": "multijitter", "sample_count": GROUP})
        means = pixel_means(sensor, sampler, part_seed(seed, "comparison"), look, several)
        groups = means.reshape(GROUPS, len(chosen), bands)
        found[chosen] = groups.transpose(1, 0, 2).reshape(len(chosen), -1)
    return found.reshape(*sky.shape, -1)


def _pairs(part: Mask, most: int) -> Ints:
    """Pixels, counted row by row, of some pairs of neighbors in a part (H, W)."""
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
    return np.unique(both[order])
