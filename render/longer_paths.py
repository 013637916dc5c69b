"""Light that is left out of frames because it takes more hits than their paths may have.

Paths of equal seeds begin alike, so what longer ones bring is known from few of them.
"""

from typing import Any

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.render.loading.air import Air
from megalopta.render.path_tracing import PathIntegrator
from megalopta.render.sensors.film import Film

_MORE_HITS = 32
"""Of leaves at 0.8 to 1.3 µm, the brightest that there are, 16 hits leave out a thousandth."""
_SEED = 0


def share_left_out(
    scene: Any, film: Film, pose: Floats, max_depth: int, air: Air | None = None
) -> Floats:
    """Return the share of the light of surfaces, by band, that more hits would bring, (B,).

    Parameters
    ----------
    scene
        Loaded.
    film
        Of few samples.
    pose : (4, 4)
    max_depth : int
        Of the frames.
    air
        The scene's haze.
    """
    short, long = (PathIntegrator(depth, air) for depth in (max_depth, max_depth + _MORE_HITS))
    found = film.expose(short.render, scene, pose, _SEED)
    whole = film.expose(long.measured, scene, pose, _SEED)
    bands, shows_surfaces = found.shape[-1], whole[..., -1] == 0
    part, all_of_it = (
        each[shows_surfaces, :bands].sum(axis=0, dtype=np.float64) for each in (found, whole)
    )
    kept = np.divide(part, all_of_it, out=np.ones(bands), where=all_of_it > 0)
    return np.asarray(1 - kept)
