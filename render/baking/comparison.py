"""Baked light against traced paths, at some pixels of a frame: all that is wrong with it.

Both look at the same points, so that what pixels see of the scene cancels. The paths of a pixel
come in independent groups, by which their own scatter is known (`render.scatter`). There are many
paths for each pixel rather than many pixels: the scatter that has to be taken off falls with their
number.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import MEASURED_EVERY, frame_seed
from megalopta.render.baking.choice import PATH, SAMPLE
from megalopta.render.sensors.primary import means_of_pixels

GROUPS = 8
GROUP = 64
"""Paths of a pixel in each group."""
_SHARE = 0.03
"""Of the work of a sequence that comparing takes."""
_FEWEST = 128

Differences = Callable[[Any, Any, Any], list[Any]]
"""Baked light less that of paths in each band, given what a `Look` is given."""


def pixels_to_compare(work: float, frames: int) -> int:
    """How many pixels of each measured frame are compared, for the work of all frames."""
    measured = -(-frames // MEASURED_EVERY)
    paths = _SHARE * work / (PATH + SAMPLE) / measured
    return max(int(paths / (GROUPS * GROUP)), _FEWEST)


def compared(
    sensor: Any, seed: int, image: NDArray[np.float32], share: float, look: Differences
) -> NDArray[np.float32]:
    """Differences (H, W, GROUPS·B) at a share of the pixels, NaN elsewhere.

    Pixels are in pairs of neighbors that show no sky, whose share the last channel of the image
    (H, W, 2·B + 1) tells.
    """
    sky, bands = image[..., -1], image.shape[-1] // 2
    found = np.full((sky.size, GROUPS * bands), np.nan, np.float32)
    chosen = _pairs(sky <= 0, round(share * sky.size / 2))
    if len(chosen):
        # Each pixel once for each group, with samples of its own.
        several = np.tile(chosen, GROUPS)
        means = means_of_pixels(sensor, frame_seed(seed, 0), GROUP, several, look)
        groups = means.reshape(GROUPS, len(chosen), bands)
        found[chosen] = groups.transpose(1, 0, 2).reshape(len(chosen), -1)
    return found.reshape(*sky.shape, -1)


def _pairs(part: NDArray[np.bool_], most: int) -> NDArray[np.int64]:
    """Pixels, counted row by row, of some pairs of neighbors in a part (H, W)."""
    number = np.arange(part.size).reshape(part.shape)
    columns, rows = part[1:] & part[:-1], part[:, 1:] & part[:, :-1]
    pairs = np.concatenate(
        [
            np.stack([number[:-1][columns], number[1:][columns]], axis=1),
            np.stack([number[:, :-1][rows], number[:, 1:][rows]], axis=1),
        ]
    )
    # The same in all passes of a strip, which are averaged.
    order = np.random.default_rng(0).permutation(len(pairs))[:most]
    return np.unique(pairs[order])
