"""The detectors by name, with the parameters of the thesis. A new detector gets one line here."""

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

_DETECTORS: tuple[Detector, ...] = (
    BlockMatching(),
    ImageInterpolation(),
    ElementaryMotionDetector(),
    NonDirectionalMultiplication(),
    NonDirectionalSummation(),
    IntensityMeasurement(),
)

METHODS: Mapping[str, Detector] = MappingProxyType({each.name: each for each in _DETECTORS})


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
