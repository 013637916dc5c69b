"""Detectors by name: those of this folder, in the order of `Detector.place`, then other packages'.

These register classes or instances in the entry points `megalopta.detectors`.
"""

import inspect
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import MappingProxyType, ModuleType
from typing import Any, TypeAlias

from megalopta.core.bounded import quoted
from megalopta.core.errors import nearest
from megalopta.core.plug_ins import plug_ins
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.gray_detector import DenseFlow, detector_from
from megalopta.flow.detectors.onnx_detector import onnx_detector
from megalopta.sensor import ImageSensor
from megalopta.sensor.information import reading_noise

Method: TypeAlias = str | Detector | DenseFlow
"""A detector: by name, itself, or made of a function."""

THESIS_METHODS: tuple[str, ...] = ("BM", "IIA", "EMD", "NDM", "NDS", "IM")
"""Names of the methods of Chapter 4, the default selection."""


def _in_file(module: ModuleType) -> Iterator[Detector]:
    for value in vars(module).values():
        is_detector = isinstance(value, type) and issubclass(value, Detector)
        if not is_detector or value.__module__ != module.__name__ or inspect.isabstract(value):
            continue
        if not any(field.is_required() for field in value.model_fields.values()):
            yield value()


def _detector(value: Any) -> Detector:
    detector = value() if isinstance(value, type) else value
    if not isinstance(detector, Detector):
        raise TypeError(f"{value!r} is not a Detector; give one")
    return detector


def _by_name() -> Mapping[str, Detector]:
    package = __name__.rpartition(".")[0]
    names = [module.name for module in iter_modules([Path(__file__).parent])]
    ours = [detector for name in names for detector in _in_file(import_module(f"{package}.{name}"))]
    ours.sort(key=lambda detector: (detector.place, detector.name))
    named = {detector.name: detector for detector in ours}
    return MappingProxyType(named | plug_ins("megalopta.detectors", _detector, named))


METHODS: Mapping[str, Detector] = _by_name()
VELOCITY_METHODS = tuple(
    name for name, detector in METHODS.items() if isinstance(detector, BlockDetector)
)
"""Names of the methods that give velocities"""


def method(chosen: Method, allows_code: bool = True) -> Detector:
    """Return the detector of a name (upper or lower case), of a function, or the detector itself.

    A name may also be `module:function`, or the path of an ONNX file (`detector_at`), unless code
    is not allowed: a name from a file is not the user's own choice.

    Raises ValueError for an unknown name, with the names that exist.
    """
    if isinstance(chosen, Detector):
        return chosen
    if callable(chosen):
        return detector_from(chosen)
    for known, detector in METHODS.items():
        if known.casefold() == chosen.casefold():
            return detector
    if allows_code and (elsewhere := detector_at(chosen)):
        return elsewhere
    more = "give module:function" if allows_code else "run code that a file names by --allow-code"
    raise ValueError(
        f"method {quoted(chosen)!r} is unknown: {nearest(chosen, METHODS, 'choose from')} (or"
        f" {more}; boards also take forms such as 'DIS √', 'DIS NLM' and 'DIS tuned')"
    )


def velocity_method(chosen: Method) -> BlockDetector:
    """Return a method that gives velocities, found as by `method`.

    Raises ValueError for any other.
    """
    detector = method(chosen)
    if not isinstance(detector, BlockDetector):
        able = ", ".join(VELOCITY_METHODS)
        raise ValueError(f"{detector.name} measures no velocity: choose from {able}")
    return detector


def for_sensor(chosen: Method, sensor: ImageSensor) -> Detector:
    """Return a detector, found as by `method`, with the noise of a sensor's readings."""
    detector = method(chosen)
    update = {"noise": reading_noise(sensor)} if isinstance(detector, BlockDetector) else {}
    return detector.model_copy(update=update)


def detector_at(reference: str) -> Detector | None:
    """Return the detector of `module:function` or of an ONNX file; None for any other text.

    The module may be in the working folder, also as FILE.py; its object may also be a detector.
    `module:function counts` is a function of counts instead of gray levels.

    Raises ValueError if there is no such module, function or file.
    """
    if reference.casefold().endswith(".onnx"):
        return onnx_detector(Path(reference))
    module, _, name = reference.partition(":")
    if not (module and name):
        return None
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)  # last: it replaces nothing that is installed
    try:
        imported = import_module(module.removesuffix(".py").replace("/", "."))
        function = getattr(imported, name.removesuffix(" counts"))
    except (Exception, SystemExit) as problem:  # foreign code can raise any exception
        reason = " ".join(str(problem).split()) or type(problem).__name__
        if isinstance(problem, SyntaxError) or "null bytes" in reason:
            reason = f"{module} is not Python ({reason})"
        raise ValueError(
            f"method {reference!r}: {reason}; give the name of a module, a colon and the name of "
            "a function in it"
        ) from None
    takes_counts = name.endswith(" counts")
    if isinstance(function, Detector) and not takes_counts:
        return function
    if not callable(function):
        raise ValueError(f"method {reference!r} is not a function; give one of two frames")
    try:
        inspect.signature(function).bind(None, None)
    except TypeError as problem:
        raise ValueError(
            f"method {reference!r}: {problem}; give a function of two frames"
        ) from None
    except ValueError:
        pass  # built in: unknown
    return detector_from(function, reference, counts=takes_counts)
