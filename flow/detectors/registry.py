"""The detectors by name, the thesis's with its parameters. A new detector gets one line here."""

from collections.abc import Mapping
from types import MappingProxyType

from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.block_matching import BlockMatching
from megalopta.flow.detectors.correlation import (
    ElementaryMotionDetector,
    NonDirectionalMultiplication,
    NonDirectionalSummation,
)
from megalopta.flow.detectors.farneback import Farneback
from megalopta.flow.detectors.image_interpolation import ImageInterpolation
from megalopta.flow.detectors.intensity import IntensityMeasurement
from megalopta.flow.detectors.inverse_search import DenseInverseSearch
from megalopta.flow.detectors.lucas_kanade import LucasKanade
from megalopta.flow.detectors.phase_correlation import PhaseCorrelation
from megalopta.flow.detectors.poisson_matching import PoissonMatching
from megalopta.flow.detectors.pooled_matching import PooledMatching
from megalopta.flow.detectors.total_variation import TotalVariation

_THESIS: tuple[Detector, ...] = (
    BlockMatching(),
    ImageInterpolation(),
    ElementaryMotionDetector(),
    NonDirectionalMultiplication(),
    NonDirectionalSummation(),
    IntensityMeasurement(),
)

_TODAY: tuple[Detector, ...] = (
    LucasKanade(),
    Farneback(),
    DenseInverseSearch(),
    TotalVariation(),
    PhaseCorrelation(),
)

_AT_THE_LIMIT: tuple[Detector, ...] = (PoissonMatching(), PooledMatching())

METHODS: Mapping[str, Detector] = MappingProxyType(
    {each.name: each for each in _THESIS + _TODAY + _AT_THE_LIMIT}
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
