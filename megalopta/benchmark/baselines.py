"""What stands on the board of whole frames beside the methods as they are.

Gray methods after a stretch that makes the noise of all counts alike, and two-frame methods on the
sums of the first and the second half of eight frames.
"""

from megalopta.benchmark.whole_frame_board import block_detector, block_methods
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.gray_detector import GrayDetector
from megalopta.flow.detectors.registry import METHODS, Method
from megalopta.flow.detectors.summed_frames import summed_frames

_GRAY = ("LK", "FB", "DIS", "TV-L1")
_BLUR_PX = 0.7
_MANY = 8


def stretched(name: str) -> GrayDetector:
    """Return a gray method that sees Anscombe's roots of the counts, slightly smoothed."""
    detector = METHODS[name]
    assert isinstance(detector, GrayDetector)
    changes = {
        "name": f"{name} √",
        "label": f"{detector.label}, roots of counts",
        "stretch": "anscombe",
        "blur_px": _BLUR_PX,
    }
    return detector.model_copy(update=changes)


def on_the_board(chosen: Method) -> Method:
    """Return the baseline of a name as the board spells it, `DIS √`; anything else as it is."""
    return next((stretched(name) for name in _GRAY if chosen == f"{name} √"), chosen)


def methods_and_baselines(frames: int) -> list[BlockDetector]:
    """Return all methods that do with so many frames, and the baselines that do."""
    found = [block_detector(name) for name in block_methods(frames)]
    found += [stretched(name) for name in _GRAY]
    if frames >= _MANY:
        found += [summed_frames(block_detector(name), _MANY) for name in _GRAY]
    return found
