"""A network in an ONNX file for the flow between two pictures, run by onnxruntime.

Inputs are as RAFT's two pictures (1, 3, H, W), RGB from 0 to 255, of one channel, or joined in one
input; the output is (1, 2, H, W), px, x before y, the last of the largest ones. Pictures are
resized to the size that the file needs; if it accepts any, padded to multiples of 8, as RAFT does.
"""

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.bounded import ARRAY_BYTES, read_bytes
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.gray_detector import DenseDetector

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

_MULTIPLE = 8
_FEWEST_PX = 128
"""RAFT pools an eighth of the picture four times."""
_TYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64, "tensor(uint8)": np.uint8}


class OnnxDetector(DenseDetector, frozen=True):
    """The flow of a network, averaged over blocks."""

    path: Path
    """ONNX file"""
    content: str
    """SHA-256 of the file"""

    def _flow(self, _: BlockGrid, pair: Floats) -> Floats:
        shape = (pair.shape[1], pair.shape[2])
        session = _session(self.path, self.content)
        padded = tuple(max(_FEWEST_PX, -(-side // _MULTIPLE) * _MULTIPLE) for side in shape)
        inputs = session.get_inputs()
        is_fixed = all(isinstance(side, int) for side in inputs[0].shape[-2:])
        size = (int(inputs[0].shape[-2]), int(inputs[0].shape[-1])) if is_fixed else padded
        if size == padded:
            more = [(0, 0), *((0, int(px)) for px in np.subtract(padded, shape))]
            pictures = np.pad(pair, more, mode="edge")
        else:
            pictures = np.array([_resized(picture, size) for picture in pair])
        channels = int(inputs[0].shape[1]) * len(inputs) // 2
        planes = np.repeat(255 * pictures, channels, axis=0).reshape(len(inputs), -1, *size)
        feed = {
            entry.name: plane[np.newaxis].astype(_TYPES[entry.type])
            for entry, plane in zip(inputs, planes, strict=True)
        }
        outputs = [np.asarray(output, np.float64) for output in session.run(None, feed)]
        flows = [output[0] for output in outputs if output.ndim == 4 and output.shape[1] == 2]
        flow = max(reversed(flows), key=np.size)
        if size == padded:
            return np.asarray(np.moveaxis(flow, 0, -1)[: shape[0], : shape[1]])
        scale = np.array(shape[::-1]) / np.array(size[::-1])
        resized = [_resized(component, shape) for component in flow]
        return np.asarray(np.dstack(resized) * scale)


def onnx_detector(path: Path) -> OnnxDetector:
    """Return the detector of an ONNX file, named after the file.

    Raises ValueError if onnxruntime is not installed, or the file holds no network for flow.
    """
    try:
        import onnxruntime  # noqa: F401
    except ImportError:
        raise ValueError(
            f"{path}: onnxruntime is not installed; run: pip install onnxruntime"
        ) from None
    try:
        content = hashlib.sha256(read_bytes(path, ARRAY_BYTES)).hexdigest()
        detector = OnnxDetector(name=path.name, label=path.stem, path=path, content=content)
        session = _session(path, content)
        inputs, outputs = session.get_inputs(), session.get_outputs()
        channels = [entry.shape[1] for entry in inputs if len(entry.shape) == 4]
        problem = ""
        if len(channels) < len(inputs) or any(entry.type not in _TYPES for entry in inputs):
            problem = "its inputs are not pictures (1, channels, H, W) of numbers"
        elif channels not in ([1, 1], [3, 3], [2], [6]):
            problem = f"its inputs have {channels} channels, not 3 and 3, 1 and 1, 6 or 2"
        elif not any(len(entry.shape) == 4 and entry.shape[1] == 2 for entry in outputs):
            problem = "it has no output (1, 2, H, W)"
    except Exception as failure:  # onnxruntime's errors have no common class
        problem = " ".join(str(failure).split())
    if problem:
        raise ValueError(f"{path}: {problem}; give an ONNX file that maps two pictures to flow")
    return detector


@lru_cache(maxsize=4)
def _session(path: Path, content: str) -> "InferenceSession":
    """Load a file of some content."""
    import onnxruntime  # optional

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])


def _resized(picture: Floats, shape: tuple[int, ...]) -> NDArray[Any]:
    import cv2

    return cv2.resize(picture, shape[::-1], interpolation=cv2.INTER_LINEAR)
