"""The long table of a benchmark: sources × methods × photons, one value for each and its interval.

What is measured of a case stands on units that were sampled independently of each other, such as
sequences, scenes or windows of frames; `megalopta.benchmark.intervals` says what the units bear.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats


class Case(NamedTuple):
    """One metric of one method at one number of photons, and where else it was measured."""

    metric: str
    method: str
    photons: float
    """Per frame or per pixel, as the benchmark says"""
    group: str = "all"
    """Which blocks"""
    pixels_pooled: int = 1
    """Side of the squares of pixels that are added"""
    frames_pooled: int = 1


Samples: TypeAlias = Mapping[Case, Floats]
"""What was measured, (units, draws) of the photons"""

Estimate: TypeAlias = Callable[[NDArray[Any], float], Iterator[tuple[str, Floats]]]
"""From counts (T, H, W) and their photons to the values (units,) of each metric"""


def measure_samples(
    draw: Callable[[float, int], NDArray[Any]],
    methods: Mapping[str, Estimate],
    fluxes: Sequence[float],
    draws: int,
    after_draw: Callable[[], object] = lambda: None,
) -> Samples:
    """Return what methods make of the same photons of one source.

    Parameters
    ----------
    draw
        From photons and the number of a draw to counts (T, H, W).
    methods
        By name.
    fluxes
        Photons per frame or per pixel, as `draw` takes them.
    draws : int
    after_draw
        Called after each draw at each flux.
    """
    found = defaultdict(list)
    for number, flux in product(range(draws), fluxes):
        counts = draw(flux, number)
        for name, estimate in methods.items():
            for metric, values in estimate(counts, flux):
                found[Case(metric, name, flux)].append(values)
        after_draw()
    return {case: np.stack(values, axis=-1) for case, values in found.items()}


def joined(sources: Iterable[Samples]) -> Samples:
    """Return the units of several sources, on which the same cases were measured, as one."""
    first, *others = sources
    return {
        case: np.concatenate([values, *(each[case] for each in others)])
        for case, values in first.items()
    }
