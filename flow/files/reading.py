"""Reading flow in the formats that programs write: `.flo`, `.flo5`, KITTI's PNG, `.pfm`, `.npy`.

All give (H, W, 2) float32 in px, +x right, +y down, NaN where undefined. Every length is checked
before memory is asked for, and nothing is unpickled.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import plain_array
from megalopta.core.bounded import ARRAY_BYTES, read_bytes
from megalopta.flow.files.flo import LARGEST_KNOWN, read_flo
from megalopta.flow.files.flo5 import read_flo5
from megalopta.flow.files.kitti_png import read_kitti_png

Flow = NDArray[np.float32]

_PFM_HEADER = re.compile(rb"PF\s+(\d{1,6})\s+(\d{1,6})\s+(-?[0-9.eE+-]{1,20})\s")


def read_flow(path: str | Path) -> Flow:
    """Read a flow (H, W, 2), px, NaN where undefined; the format is told by the suffix.

    Raises
    ------
    ValueError
        When the suffix is of none of the formats, or the file is damaged.
    """
    path = Path(path)
    read = _READERS.get(path.suffix.lower())
    if read is None:
        raise ValueError(f"{path}: flow is read from {', '.join(_READERS)}")
    flow = read(path)
    if flow.ndim != 3 or flow.shape[-1] != 2 or 0 in flow.shape:
        raise ValueError(f"{path} holds an array of shape {flow.shape}: a flow is (H, W, 2)")
    known = (np.abs(flow) <= LARGEST_KNOWN).all(axis=-1, keepdims=True)  # of NaN, False
    return np.where(known, flow, np.float32(np.nan)).astype(np.float32)


def _read_pfm(path: Path) -> Flow:
    """Portable float map of three channels, of which the third is not read; rows from the bottom.

    Of the three-channel convention of FlyingThings3D and Monkaa (Mayer et al. 2016).
    """
    content = read_bytes(path, ARRAY_BYTES)
    header = _PFM_HEADER.match(content)
    if header is None:
        raise ValueError(f"{path} is no .pfm file of three channels")
    width, height, scale = int(header[1]), int(header[2]), float(header[3])
    expected = 12 * width * height
    if len(content) - header.end() != expected:
        raise ValueError(
            f"{path} has {len(content) - header.end()} bytes of values, {width} × {height} px need"
            f" {expected}: the file is damaged"
        )
    values = np.frombuffer(content, "<f4" if scale < 0 else ">f4", offset=header.end())
    return values.reshape(height, width, 3)[::-1, :, :2].astype(np.float32)


def _read_npy(path: Path) -> Flow:
    """NumPy array (H, W, 2) of floating point, which can tell that a flow is unknown.

    Whole numbers may be KITTI's codes as well as pixels.
    """
    values = plain_array(read_bytes(path, ARRAY_BYTES))
    if values is None:
        raise ValueError(f"{path} is no whole .npy file of plain numbers; write it with numpy.save")
    if values.ndim != 3 or values.shape[-1] != 2 or values.dtype.kind != "f":
        is_turned = values.ndim == 3 and values.shape[0] == 2
        remedy = "numpy.moveaxis(flow, 0, -1)" if is_turned else "astype('float32')"
        raise ValueError(
            f"{path} holds {values.dtype} {values.shape}: a flow is float32 (H, W, 2), px, x "
            f"before y; write it so, such as by {remedy}"
        )
    return values.astype(np.float32)


_READERS: Mapping[str, Callable[[Path], Flow]] = {
    ".flo": read_flo,
    ".flo5": read_flo5,
    ".png": read_kitti_png,
    ".pfm": _read_pfm,
    ".npy": _read_npy,
}
FLOW_SUFFIXES = tuple(_READERS)
