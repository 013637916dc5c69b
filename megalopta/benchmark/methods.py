"""The methods that are ranked, by the names that the page gives them."""

import inspect
from collections.abc import Iterable, Mapping
from pathlib import Path

from megalopta.core.freshness import digest
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import METHODS, Method, method

Methods = Mapping[str, BlockDetector]


def velocity_methods(chosen: Iterable[Method]) -> Methods:
    """Return methods by name.

    Raises
    ------
    ValueError
        When one is unknown, gives no velocities, or has the name of another.
    """
    found: dict[str, BlockDetector] = {}
    for detector in map(method, chosen):
        if not isinstance(detector, BlockDetector):
            raise ValueError(
                f"methods: {detector.name!r} is no method that gives velocities; choose from "
                f"{', '.join(velocity_names())}, or give module:function or an ONNX file"
            )
        if detector.name in found:
            raise ValueError(f"methods: {detector.name!r} is there twice; give each once")
        found[detector.name] = detector
    return found


def velocity_names() -> tuple[str, ...]:
    """Names of the methods that come along and give velocities."""
    return tuple(name for name, each in METHODS.items() if isinstance(each, BlockDetector))


def identity(detector: Detector) -> str:
    """Tell a method from others: its parameters, and the file that a function stands in."""
    function = getattr(detector, "function", None)
    file = inspect.getsourcefile(inspect.unwrap(function)) if inspect.isfunction(function) else None
    source = Path(file).read_bytes() if file and Path(file).is_file() else b""
    return digest(detector.model_dump_json(), source)
