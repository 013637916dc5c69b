"""A look at a few frames, first and last among them, to learn how many rays an error takes."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr
from megalopta.render.baking.cells import CellFinder
from megalopta.render.baking.light import BakedLight
from megalopta.render.baking.visibility import all_views, survey
from megalopta.scenes.cameras.base import Camera

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
        self._step = max(camera.width * camera.height // _PIXELS, 1)
        self._frames = poses[np.linspace(0, len(poses) - 1, _FRAMES).round().astype(int)]
        seen = sum(
            survey(loaded, finder, light.cells, camera, pose[None], seed, _RAYS, self._step)[0]
            for pose in self._frames
        )
        light.bake(np.flatnonzero(seen).astype(np.uint32))
        light.smooth()

    @property
    def rays(self) -> int:
        """Of a frame: they are looked along at once, as tracing paths has a price of its own."""
        return _RAYS * len(range(0, self._camera.width * self._camera.height, self._step))

    def errors(self, look: Callable[[Any], list[Any]]) -> tuple[float, float]:
        """RMS of the standing error, and of one ray's scatter, of pixels of surfaces alone.

        Both over the mean radiance. `look` gives what rays see: the light of each band, as many
        draws of its error, and whether it is the sky.
        """
        squares, scatter, light, pixels = 0.0, 0.0, 0.0, 0
        for pose in self._frames:
            found = look(all_views(self._camera, pose, _RAYS, self._seed, self._step))
            bands = len(found) // 2
            seen: Any = sum(found[:bands])
            parts = seen, dr.square(seen), sum(found[bands:-1]), found[-1]
            dr.eval(parts)
            views = np.array([np.array(each) for each in parts]).reshape(4, _RAYS, -1)
            radiance, square, standing, sky = views.sum(axis=1, dtype=np.float64)
            surface = sky == 0
            squares += float(np.sum(standing[surface] ** 2))
            scatter += float(np.sum((_RAYS * square - radiance**2)[surface]))
            light += float(np.sum(radiance[surface]))
            pixels += int(np.sum(surface))
        if not light:
            return 0.0, 0.0
        scatter *= _RAYS / (_RAYS - 1)
        return math.sqrt(squares * pixels) / light, math.sqrt(max(scatter, 0) * pixels) / light
