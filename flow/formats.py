"""Middlebury .flo files: the tag "PIEH", width and height as int32, then (u, v) float32 by rows.

Everything is little-endian. An undefined flow is stored as 1e10 in both components, and whatever
exceeds 1e9 in either is read back as NaN in both (Baker et al., IJCV 92, 2011, flowIO of the
Middlebury evaluation). A file appears whole or not at all.
"""

import re
import struct
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import plain_array
from megalopta.core.bounded import ARRAY_BYTES, check_file, read_bytes
from megalopta.core.files import atomic_write

TAG = b"PIEH"
UNKNOWN = 1e10
LARGEST_KNOWN = 1e9
_HEADER = struct.Struct("<4sii")
_LARGEST_SIDE = 100_000


def write_flo(path: str | Path, flow: NDArray[np.floating]) -> None:
    """Write a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    Raises
    ------
    ValueError
        When the array is no flow, or holds a value that would be read as undefined.
    """
    check_flow(flow)
    if max(flow.shape[:2]) > _LARGEST_SIDE:
        raise ValueError(f"flow of shape {flow.shape}: a side may have {_LARGEST_SIDE} px at most")
    if np.any(np.abs(flow) > LARGEST_KNOWN):
        raise ValueError(
            f"flow exceeds {LARGEST_KNOWN:g} px, which .flo keeps for undefined: store NaN instead"
        )
    undefined = np.isnan(flow).any(axis=-1, keepdims=True)
    values = np.where(undefined, UNKNOWN, flow).astype("<f4")
    height, width = flow.shape[:2]
    with atomic_write(Path(path)) as temporary:
        temporary.write_bytes(_HEADER.pack(TAG, width, height) + values.tobytes())


def read_flo(path: str | Path) -> NDArray[np.float32]:
    """Read a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    Raises ValueError when the file is not a whole .flo file.
    """
    content = read_bytes(path, ARRAY_BYTES)
    if len(content) < _HEADER.size:
        raise ValueError(f"{path} has {len(content)} bytes: too short for a .flo file")
    tag, width, height = _HEADER.unpack_from(content)
    if tag != TAG:
        raise ValueError(f"{path} starts with {tag!r}: a .flo file starts with {TAG!r}")
    if not (0 < width <= _LARGEST_SIDE and 0 < height <= _LARGEST_SIDE):
        raise ValueError(f"{path} claims {width} × {height} px: the file is damaged")
    expected = _HEADER.size + 8 * width * height
    if len(content) != expected:
        raise ValueError(
            f"{path} has {len(content)} bytes, {width} × {height} px need {expected}: the file is"
            " damaged"
        )
    stored = np.frombuffer(content, "<f4", offset=_HEADER.size).reshape(height, width, 2)
    known = (np.abs(stored) <= LARGEST_KNOWN).all(axis=-1, keepdims=True)
    return np.where(known, stored, np.float32(np.nan)).astype(np.float32)


def check_flow(flow: NDArray[np.floating]) -> None:
    """Refuse, with ValueError, what is no flow (H, W, 2) of one pixel or more."""
    if flow.ndim != 3 or flow.shape[-1] != 2 or 0 in flow.shape:
        raise ValueError(f"flow of shape {flow.shape}: give (H, W, 2)")


Flow = NDArray[np.float32]

_PFM_HEADER = re.compile(rb"PF\s+(\d{1,6})\s+(\d{1,6})\s+(-?[0-9.eE+-]{1,20})\s")

_GZIP_LEVEL = 5
_LARGEST_BYTES = 2**32

_CODES_PER_PX = 64
_CODE_OF_ZERO = 2**15
_LARGEST_CODE = 2**16 - 1
_MOST_PX = 10**8
"""A file of a few megabytes can claim any number."""


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


def write_flo5(path: str | Path, flow: NDArray[np.floating]) -> None:
    """Write a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    As Spring's: HDF5 with one dataset, "flow" (H, W, 2) float32 (Mehl et al., CVPR 2023).

    Raises ValueError when the array is no flow.
    """
    check_flow(flow)
    with atomic_write(Path(path)) as temporary, h5py.File(temporary, "w") as file:
        file.create_dataset(
            "flow", data=flow.astype("<f4"), compression="gzip", compression_opts=_GZIP_LEVEL
        )


def read_flo5(path: str | Path) -> NDArray[np.float32]:
    """Read a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    Raises ValueError when the file is none.
    """
    try:
        check_file(path)
        with h5py.File(path, "r") as file:
            is_here = isinstance(file.get("flow", getlink=True), h5py.HardLink)
            stored = file["flow"] if is_here else None
            if stored is None or stored.is_virtual or stored.external:
                raise ValueError("no flow, or it lies in another file")
            if stored.size * stored.dtype.itemsize > _LARGEST_BYTES:
                raise ValueError("more than 4 GiB")
            flow = stored[()]
    except FileNotFoundError:
        raise
    except Exception as problem:  # of a damaged file, anything
        reason = " ".join(str(problem).split())[:160]
        raise ValueError(f"{path} is no whole .flo5 file ({reason})") from None
    if flow.ndim != 3 or flow.shape[-1] != 2 or flow.dtype.kind != "f":
        raise ValueError(f"{path}: flow of shape {flow.shape} and type {flow.dtype}, not (H, W, 2)")
    return np.asarray(flow, np.float32)


def write_kitti_png(path: str | Path, flow: NDArray[np.floating]) -> None:
    """Write a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    As KITTI's, of 16 bits: u·64 + 2¹⁵, v·64 + 2¹⁵ and whether the flow is known, as red, green and
    blue. Steps of 1/64 px, from −512 to nearly 512 px; a flow beyond is stored as not known (Menze
    and Geiger, CVPR 2015, the benchmark's development kit).

    Raises ValueError when the array is no flow.
    """
    check_flow(flow)
    codes = np.rint(flow.astype(np.float64) * _CODES_PER_PX + _CODE_OF_ZERO)
    with np.errstate(invalid="ignore"):
        known = ((codes >= 0) & (codes <= _LARGEST_CODE)).all(axis=-1)
    image = np.zeros((*flow.shape[:2], 3), np.uint16)
    image[known, 0], image[known, 1], image[known, 2] = *codes[known].T, 1
    with atomic_write(Path(path)) as temporary:
        temporary.write_bytes(cv2.imencode(".png", image[..., ::-1])[1].tobytes())


def read_kitti_png(path: str | Path) -> NDArray[np.float32]:
    """Read a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    Raises ValueError when the file is no 16-bit PNG of three channels.
    """
    content = read_bytes(path, ARRAY_BYTES)
    width, height = struct.unpack(">II", content[16:24].ljust(8, b"\0"))  # of PNG's first chunk
    if width * height > _MOST_PX:
        raise ValueError(f"{path} claims {width} × {height} px; give flow of fewer pixels")
    coded = np.frombuffer(content, np.uint8)
    image = cv2.imdecode(coded, cv2.IMREAD_UNCHANGED) if content else None
    if image is None or image.dtype != np.uint16 or image.ndim != 3 or image.shape[-1] != 3:
        raise ValueError(f"{path} is no 16-bit PNG with three channels, as KITTI's flow is")
    flow = (image[..., :0:-1].astype(np.float32) - _CODE_OF_ZERO) / _CODES_PER_PX
    flow[image[..., 0] == 0] = np.nan
    return np.asarray(flow, np.float32)


_READERS: Mapping[str, Callable[[Path], Flow]] = {
    ".flo": read_flo,
    ".flo5": read_flo5,
    ".png": read_kitti_png,
    ".pfm": _read_pfm,
    ".npy": _read_npy,
}
FLOW_SUFFIXES = tuple(_READERS)
