"""A look at a few frames, first and last among them, to learn how many rays an error takes."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi
from megalopta.render.baking.cells import CellFinder
from megalopta.render.baking.light import BakedLight
from megalopta.render.baking.visibility import survey, views
from megalopta.scenes.cameras import Camera

_FRAMES = 3
_RAYS = 32
"""Per pixel and frame."""
_PIXELS = 2000
"""Of a frame, about; of a small one all."""


class Pilot:
    """A few frames of those of a camera at poses (T, 4, 4)."""

    def __init__(
        self,
        loaded: Any,
        finder: CellFinder,
        light: BakedLight,
        camera: Camera,
        poses: NDArray[np.float64],
        seed: int,
    ) -> None:
        self._camera, self._seed = camera, seed
        pixels = camera.width * camera.height
        self._step = max(pixels // _PIXELS, 1)
        self.rays = -(-pixels // self._step)
        """How many are looked at together."""
        self._frames = poses[np.linspace(0, len(poses) - 1, _FRAMES).round().astype(int)]
        seen = sum(
            survey(loaded, finder, light.cells, camera, pose[None], seed, _RAYS, self._step)
            for pose in self._frames
        )
        light.bake(np.flatnonzero(seen).astype(np.uint32))
        light.smooth()

    def standing_error(self, look: Callable[[Any], list[Any]]) -> float:
        """RMS of the standing error over the mean radiance, of pixels of surfaces alone.

        `look` gives what rays see: the light of each band, as many draws of its error, and whether
        it is the sky.
        """
        squares, light, pixels = 0.0, 0.0, 0
        for pose in self._frames:
            total = [dr.zeros(mi.Float)] * 3
            for rays in views(self._camera, pose[None], _RAYS, self._seed, self._step):
                found = look(rays)
                bands = len(found) // 2
                parts = sum(found[:bands]), sum(found[bands:-1]), found[-1]
                total = [a + b for a, b in zip(total, parts, strict=True)]
                dr.eval(total)
            radiance, standing, sky = (np.array(each, np.float64) for each in total)
            squares += float(np.sum(standing[sky == 0] ** 2))
            light += float(np.sum(radiance[sky == 0]))
            pixels += int(np.sum(sky == 0))
        return math.sqrt(squares * pixels) / light if light else 0.0
