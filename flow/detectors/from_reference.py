"""Detectors that are named by where they are: a function of a module, or a file of a network."""

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.from_function import detector_from
from megalopta.flow.detectors.onnx_detector import onnx_detector


def detector_at(reference: str) -> Detector | None:
    """Return the detector of `module:function` or of an ONNX file; None for any other text.

    The module may lie in the working folder; what it names may also be a detector.

    Raises
    ------
    ValueError
        When there is no such module, function or file.
    """
    if reference.casefold().endswith(".onnx"):
        return onnx_detector(Path(reference))
    module, _, name = reference.partition(":")
    if not (module and name):
        return None
    found = _attribute(reference, module, name)
    if isinstance(found, Detector):
        return found
    if not callable(found):
        raise ValueError(f"method {reference!r} is no function; give one of two frames")
    return detector_from(found, reference)


def _attribute(reference: str, module: str, name: str) -> Any:
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError, SyntaxError) as problem:
        raise ValueError(
            f"method {reference!r}: {problem}; give the name of a module, a colon and the name of "
            "a function in it"
        ) from None
