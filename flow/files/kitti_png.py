"""KITTI's 16-bit PNG: u·64 + 2¹⁵, v·64 + 2¹⁵ and whether the flow is known, as red, green and blue.

Steps of 1/64 px, from −512 to nearly 512 px; a flow beyond is stored as not known (Menze & Geiger,
CVPR 2015, the benchmark's development kit).
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from megalopta.files import atomic_write
from megalopta.flow.files.checking import check_flow

_PER_PX = 64
_ZERO = 2**15
_LARGEST = 2**16 - 1


def write_kitti_png(path: str | Path, flow: NDArray[np.floating]) -> None:
    """Write a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    Raises
    ------
    ValueError
        When the array is no flow.
    """
    check_flow(flow)
    codes = np.rint(flow.astype(np.float64) * _PER_PX + _ZERO)
    with np.errstate(invalid="ignore"):
        known = ((codes >= 0) & (codes <= _LARGEST)).all(axis=-1)
    image = np.zeros((*flow.shape[:2], 3), np.uint16)
    image[known, 0], image[known, 1], image[known, 2] = *codes[known].T, 1
    with atomic_write(Path(path)) as temporary:
        temporary.write_bytes(cv2.imencode(".png", image[..., ::-1])[1].tobytes())


def read_kitti_png(path: str | Path) -> NDArray[np.float32]:
    """Read a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    Raises
    ------
    ValueError
        When the file is no 16-bit PNG of three channels.
    """
    content = np.frombuffer(Path(path).read_bytes(), np.uint8)
    image = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if content.size else None
    if image is None or image.dtype != np.uint16 or image.ndim != 3 or image.shape[-1] != 3:
        raise ValueError(f"{path} is no 16-bit PNG with three channels, as KITTI's flow is")
    flow = (image[..., :0:-1].astype(np.float32) - _ZERO) / _PER_PX
    flow[image[..., 0] == 0] = np.nan
    return np.asarray(flow, np.float32)
