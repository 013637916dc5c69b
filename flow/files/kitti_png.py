"""KITTI's 16-bit PNG: u·64 + 2¹⁵, v·64 + 2¹⁵ and whether the flow is known, as red, green and blue.

Steps of 1/64 px, from −512 to nearly 512 px; a flow beyond is stored as not known (Menze & Geiger,
CVPR 2015, the benchmark's development kit).
"""

import struct
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import ARRAY_BYTES, read_bytes
from megalopta.core.files import atomic_write
from megalopta.flow.files.checking import check_flow

_PER_PX = 64
_ZERO = 2**15
_LARGEST = 2**16 - 1
_MOST_PX = 10**8
"""A file of a few megabytes can claim any number."""


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
    content = read_bytes(path, ARRAY_BYTES)
    width, height = struct.unpack(">II", content[16:24].ljust(8, b"\0"))  # of PNG's first chunk
    if width * height > _MOST_PX:
        raise ValueError(f"{path} claims {width} × {height} px; give flow of fewer pixels")
    coded = np.frombuffer(content, np.uint8)
    image = cv2.imdecode(coded, cv2.IMREAD_UNCHANGED) if content else None
    if image is None or image.dtype != np.uint16 or image.ndim != 3 or image.shape[-1] != 3:
        raise ValueError(f"{path} is no 16-bit PNG with three channels, as KITTI's flow is")
    flow = (image[..., :0:-1].astype(np.float32) - _ZERO) / _PER_PX
    flow[image[..., 0] == 0] = np.nan
    return np.asarray(flow, np.float32)
