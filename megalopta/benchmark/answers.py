"""What is scored: flow of files, or what a method says of the truth's own frames."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from megalopta.benchmark.pairing import (
    Frame,
    Truths,
    pictures_of,
    submitted_flows,
)
from megalopta.core.errors import UserError
from megalopta.core.pictures import read_picture
from megalopta.flow.detectors.gray_detector import DenseDetector
from megalopta.flow.detectors.registry import Method, method
from megalopta.flow.files.formats import read_flow

Answers = Mapping[Frame, tuple[str, Callable[[], NDArray[Any]]]]
"""Where the answer to a frame comes from, and what gives it, (H, W, 2) in px"""


def answers_of(flow: str | Path | Method, truths: Truths) -> Mapping[str, Answers]:
    """Return the answers to all frames, by pass. Raises UserError."""
    if isinstance(flow, str | Path) and Path(flow).is_dir():
        passes = submitted_flows(Path(flow), truths)
        return {
            name: {frame: (str(path), partial(read_flow, path)) for frame, path in paths.items()}
            for name, paths in passes.items()
        }
    detector = _dense(flow)
    return {
        name: {
            frame: (str(first), partial(_answer, detector, first, second))
            for frame, (first, second) in pictures.items()
        }
        for name, pictures in pictures_of(truths).items()
    }


def name_of(flow: str | Path | Method) -> str:
    """Name of what gave the flow, unless it is told."""
    if isinstance(flow, str | Path) and Path(flow).is_dir():
        return Path(flow).resolve().name
    return _dense(flow).name


def _dense(flow: str | Path | Method) -> DenseDetector:
    try:
        found = method(str(flow) if isinstance(flow, Path) else flow)
    except ValueError as problem:
        raise UserError(f"{flow}: no such folder; {problem}") from None
    if not isinstance(found, DenseDetector):
        raise UserError(f"{found.name} gives no flow at every pixel; give a method that does")
    return found


def _answer(detector: DenseDetector, first: Path, second: Path) -> NDArray[Any]:
    return detector.dense(read_picture(first, "L"), read_picture(second, "L"))
