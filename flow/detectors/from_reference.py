"""Detectors that are named by where they are: a function of a module, or a file of a network."""

import inspect
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
    try:
        inspect.signature(found).bind(None, None)
    except TypeError as problem:
        raise ValueError(
            f"method {reference!r}: {problem}; give a function of two frames"
        ) from None
    except ValueError:
        pass  # built in: it does not tell
    return detector_from(found, reference)


def _attribute(reference: str, module: str, name: str) -> Any:
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)  # last: nothing there takes the place of what is installed
    try:
        return getattr(import_module(module), name)
    except (Exception, SystemExit) as problem:  # somebody else's code can raise anything
        told = " ".join(str(problem).split()) or type(problem).__name__
        raise ValueError(
            f"method {reference!r}: {told}; give the name of a module, a colon and the name of "
            "a function in it"
        ) from None
