"""Spring's .flo5: HDF5 with one dataset, "flow" (H, W, 2) float32, NaN where it is undefined.

Mehl et al., CVPR 2023.
"""

from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import check_file
from megalopta.core.files import atomic_write
from megalopta.flow.files.checking import check_flow

_COMPRESSION = 5
_LARGEST_BYTES = 2**32


def write_flo5(path: str | Path, flow: NDArray[np.floating]) -> None:
    """Write a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    Raises
    ------
    ValueError
        When the array is no flow.
    """
    check_flow(flow)
    with atomic_write(Path(path)) as temporary, h5py.File(temporary, "w") as file:
        file.create_dataset(
            "flow", data=flow.astype("<f4"), compression="gzip", compression_opts=_COMPRESSION
        )


def read_flo5(path: str | Path) -> NDArray[np.float32]:
    """Read a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    Raises
    ------
    ValueError
        When the file is none.
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
