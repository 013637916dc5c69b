"""The detectors by name, the thesis's with its parameters. A new detector gets one line here."""

from collections.abc import Mapping
from types import MappingProxyType

from megalopta.flow.block_matching import BlockMatching
from megalopta.flow.correlation import (
    ElementaryMotionDetector,
    NonDirectionalMultiplication,
    NonDirectionalSummation,
)
from megalopta.flow.detector import Detector
from megalopta.flow.image_interpolation import ImageInterpolation
from megalopta.flow.intensity import IntensityMeasurement
from megalopta.flow.poisson_matching import PoissonMatching
from megalopta.flow.pooled_matching import PooledMatching

_THESIS: tuple[Detector, ...] = (
    BlockMatching(),
    ImageInterpolation(),
    ElementaryMotionDetector(),
    NonDirectionalMultiplication(),
    NonDirectionalSummation(),
    IntensityMeasurement(),
)

_AT_THE_LIMIT: tuple[Detector, ...] = (PoissonMatching(), PooledMatching())

METHODS: Mapping[str, Detector] = MappingProxyType(
    {each.name: each for each in _THESIS + _AT_THE_LIMIT}
)

THESIS_METHODS: tuple[str, ...] = tuple(each.name for each in _THESIS)
"""Names of the methods of Chapter 4, which run unless others are asked for."""


def method(name: str) -> Detector:
    """Return the detector of this name, in upper or lower case.

    Raises
    ------
    ValueError
        When there is none, with the names that exist.
    """
    for known, detector in METHODS.items():
        if known.casefold() == name.casefold():
            return detector
    raise ValueError(f"method {name!r} is unknown: choose from {', '.join(METHODS)}")
