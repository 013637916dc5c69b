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
from megalopta.flow.farneback import Farneback
from megalopta.flow.image_interpolation import ImageInterpolation
from megalopta.flow.intensity import IntensityMeasurement
from megalopta.flow.inverse_search import DenseInverseSearch
from megalopta.flow.lucas_kanade import LucasKanade
from megalopta.flow.phase_correlation import PhaseCorrelation
from megalopta.flow.poisson_matching import PoissonMatching
from megalopta.flow.pooled_matching import PooledMatching
from megalopta.flow.total_variation import TotalVariation

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
