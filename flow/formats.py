"""Flow files: `.flo`, `.flo5`, KITTI's PNG, `.pfm`, `.npy`.

All hold (H, W, 2) float32 in px, +x right, +y down, NaN where undefined. Every length is checked
before memory is allocated, and nothing is unpickled.

- `.flo`, Middlebury's: the tag "PIEH", width and height as int32, then (u, v) float32 by rows, all
  little-endian. An undefined flow is stored as 1e10 in both components; a value above 1e9 in
  either is read as NaN in both (Baker et al., IJCV 92, 2011, flowIO of the evaluation).
- `.flo5`, Spring's: HDF5 with one dataset, "flow" (H, W, 2) float32 (Mehl et al., CVPR 2023).
- KITTI's PNG of 16 bits: u·64 + 2¹⁵, v·64 + 2¹⁵ and whether the flow is known, as red, green and
  blue; a flow beyond ±512 px is stored as unknown (Menze and Geiger, CVPR 2015).
- `.pfm`, a portable float map of three channels, the third of which is ignored; rows from the
  bottom, values times its scale, as in FlyingThings3D and Monkaa (Mayer et al. 2016).
- `.npy`, of floating point, which can mark unknown flow.
"""

import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray

from megalopta.core import bounded
from megalopta.core.errors import UserError
from megalopta.core.files import atomic_write
from megalopta.core.pictures import checked_png, read_pfm, write_codes

Flow = NDArray[np.float32]

_TAG = b"PIEH"
_HEADER = struct.Struct("<4sii")
_UNKNOWN, _LARGEST_KNOWN = 1e10, 1e9

KITTI_SCALE = 64.0
"""Codes of a pixel in flow as PNG, of KITTI; DSEC has 128."""
_CODE_OF_ZERO, _LARGEST_CODE = 2**15, 2**16 - 1
_PX_BYTES = 150
"""Memory of a pixel of a flow that is compared with another, at most (bytes)."""


def read_flow(path: str | Path, *, png_scale: float = KITTI_SCALE) -> Flow:
    """Read a flow (H, W, 2), px, NaN where undefined, in the format of the suffix.

    `png_scale` are the codes of a pixel in a PNG, which cannot state it: 64 in KITTI, 128 in DSEC.
    Raises ValueError if the suffix is unknown, or the file is damaged.
    """
    path = Path(path)
    read = _READERS.get(path.suffix.lower())
    if read is None:
        raise ValueError(f"{path}: flow is read from {', '.join(_READERS)}")
    bounded.check_decoded(path, (path.stat().st_size,), 3)  # copies of its bytes
    flow = read_kitti_png(path, png_scale) if read is read_kitti_png else read(path)
    if flow.ndim != 3 or flow.shape[-1] != 2 or 0 in flow.shape:
        raise ValueError(f"{path} holds an array of shape {flow.shape}: a flow is (H, W, 2)")
    return _known(flow)


def read_uncertainty(path: Path, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Read the expected error (H, W) of a flow, px, from `.npy`. Raises ValueError."""
    values = bounded.plain_array(bounded.read_bytes(path, bounded.ARRAY_BYTES), "f")
    if values is None or values.shape != shape or (values < 0).any():
        raise ValueError(
            f"{path} is no complete .npy file of float32 {shape}: write the expected error of each "
            "pixel, px, 0 or more, with numpy.save; NaN where it is unknown"
        )
    return values.astype(np.float64)


def write_flo(path: str | Path, flow: NDArray[np.floating]) -> None:
    """Write a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    Raises ValueError if the array is not a flow, or holds a value that would be read as undefined.

    Examples
    --------
    >>> write_flo("right.flo", np.full((4, 4, 2), (1.5, 0)))
    >>> read_flow("right.flo")[0, 0]
    array([1.5, 0. ], dtype=float32)
    """
    _check(flow)
    if np.any(np.abs(flow) > _LARGEST_KNOWN):
        raise ValueError(
            f"flow exceeds {_LARGEST_KNOWN:g} px, which .flo keeps for undefined: store NaN instead"
        )
    undefined = np.isnan(flow).any(axis=-1, keepdims=True)
    values = np.where(undefined, _UNKNOWN, flow).astype("<f4")
    height, width = flow.shape[:2]
    with atomic_write(Path(path)) as temporary:
        temporary.write_bytes(_HEADER.pack(_TAG, width, height) + values.tobytes())


def read_flo(path: str | Path) -> Flow:
    """Read a `.flo` file. Raises ValueError if it is damaged."""
    content = bounded.read_bytes(path, bounded.ARRAY_BYTES)
    if len(content) < _HEADER.size:
        raise ValueError(f"{path} has {len(content)} bytes: too short for a .flo file")
    tag, width, height = _HEADER.unpack_from(content)
    if tag != _TAG:
        raise ValueError(f"{path} starts with {tag!r}: a .flo file starts with {_TAG!r}")
    if min(width, height) < 1 or len(content) != _HEADER.size + 8 * width * height:
        raise ValueError(
            f"{path} has {len(content)} bytes, not those of {width} × {height} px: it is damaged"
        )
    bounded.check_decoded(path, (height, width), _PX_BYTES)
    return _known(np.frombuffer(content, "<f4", offset=_HEADER.size).reshape(height, width, 2))


def write_flo5(path: str | Path, flow: NDArray[np.floating]) -> None:
    """Write a flow (H, W, 2), px, as `.flo5`. Raises ValueError if the array is not a flow."""
    _check(flow)
    values = flow.astype("<f4")
    with atomic_write(Path(path)) as temporary, h5py.File(temporary, "w") as file:
        file.create_dataset("flow", data=values, compression="gzip", compression_opts=5)


def read_flo5(path: str | Path) -> Flow:
    """Read a `.flo5` file. Raises ValueError if it is damaged."""
    try:
        with bounded.opened_hdf5(path) as file:
            flow = bounded.numbers_in(file, "flow", "f", 3, _PX_BYTES / 2)
    except (FileNotFoundError, UserError):
        raise
    except Exception as problem:  # a damaged file can raise any exception
        reason = " ".join(str(problem).split())[:160]
        raise ValueError(f"{path} is not a complete .flo5 file ({reason})") from None
    return np.asarray(flow, np.float32)


def write_kitti_png(path: str | Path, flow: NDArray[np.floating]) -> None:
    """Write a flow (H, W, 2), px, as KITTI's PNG. Raises ValueError if the array is not a flow."""
    _check(flow)
    codes = np.rint(flow.astype(np.float64) * KITTI_SCALE + _CODE_OF_ZERO)
    with np.errstate(invalid="ignore"):
        known = ((codes >= 0) & (codes <= _LARGEST_CODE)).all(axis=-1)
    image = np.zeros((*flow.shape[:2], 3), np.uint16)
    image[known, 0], image[known, 1], image[known, 2] = *codes[known].T, 1
    write_codes(Path(path), image)


def read_kitti_png(path: str | Path, png_scale: float = KITTI_SCALE) -> Flow:
    """Read KITTI's PNG. Raises ValueError if it does not have 16 bits and three channels."""
    if not 0 < png_scale < np.inf:
        raise ValueError(f"png_scale {png_scale:g}: give the codes of a pixel, such as 64 or 128")
    content = bounded.read_bytes(path, bounded.ARRAY_BYTES)
    bounded.check_decoded(path, struct.unpack(">II", content[16:24].ljust(8, b"\0")), _PX_BYTES)
    image = None
    with suppress(ValueError, struct.error):
        coded = np.frombuffer(checked_png(content), np.uint8)
        image = cv2.imdecode(coded, cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint16 or image.ndim != 3 or image.shape[-1] != 3:
        raise ValueError(f"{path} is not a 16-bit PNG with three channels, as KITTI's flow")
    flow = (image[..., :0:-1].astype(np.float32) - _CODE_OF_ZERO) / png_scale
    flow[image[..., 0] == 0] = np.nan
    return np.asarray(flow, np.float32)


def _read_pfm(path: Path) -> Flow:
    values = read_pfm(path)
    if values.ndim != 3:
        raise ValueError(f"{path} is not a .pfm file of three channels")
    bounded.check_decoded(path, values.shape[:2], _PX_BYTES)
    return values[..., :2]


def _read_npy(path: Path) -> Flow:
    values = bounded.plain_array(bounded.read_bytes(path, bounded.ARRAY_BYTES))
    if values is None:
        raise ValueError(f"{path} is not a complete .npy file of numbers; write it with numpy.save")
    if values.ndim != 3 or values.shape[-1] != 2 or values.dtype.kind != "f":
        is_turned = values.ndim == 3 and values.shape[0] == 2
        remedy = "numpy.moveaxis(flow, 0, -1)" if is_turned else "astype('float32')"
        raise ValueError(
            f"{path} holds {values.dtype} {values.shape}: a flow is float32 (H, W, 2), px, x "
            f"before y; convert it, for example by {remedy}"
        )
    return values.astype(np.float32)


def _check(flow: NDArray[np.floating]) -> None:
    if flow.ndim != 3 or flow.shape[-1] != 2 or 0 in flow.shape:
        raise ValueError(f"flow of shape {flow.shape}: give (H, W, 2)")


def _known(flow: Flow) -> Flow:
    """Flow with NaN in both components where either is too large or NaN."""
    known = (np.abs(flow) <= _LARGEST_KNOWN).all(axis=-1, keepdims=True)
    return np.where(known, flow, np.float32(np.nan)).astype(np.float32)


_READERS: Mapping[str, Callable[[Path], Flow]] = {
    ".flo": read_flo,
    ".flo5": read_flo5,
    ".png": read_kitti_png,
    ".pfm": _read_pfm,
    ".npy": _read_npy,
}
FLOW_SUFFIXES = tuple(_READERS)
