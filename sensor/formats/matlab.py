"""Arrays of frames in MATLAB's `.mat` files, of version 5 and 7.3, and in HDF5.

MATLAB's axes are (rows, columns, frames), which HDF5 holds in reverse order. Other HDF5 holds
(frames, rows, columns), or AlliGator's gate images, an array (rows, columns) each.
"""

import io
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
from numpy.typing import NDArray

from megalopta.core import bounded
from megalopta.core.errors import DamagedFileError
from megalopta.core.files import natural_key
from megalopta.sensor.formats.conditions import conditions_in
from megalopta.sensor.formats.events import HDF5_SIGNATURE
from megalopta.sensor.formats.recorded_frames import Stack, file_bytes

SIGNATURE = b"MATLAB"
_GATES = "Gate Images"
_COMPRESSED, _HEAD_BYTES, _MOST_VARIABLES = 15, 128, 1000
_NUMBERS = ("double", "single", "int", "uint", "logical")


@contextmanager
def opened_arrays(path: Path, name: str | None) -> Iterator[Stack]:
    """Open the one stack of frames in a file, else its one frame, or the array of this name.

    Raises DamagedFileError if there is none, or several, or the file is damaged.
    """
    content = file_bytes(path)
    is_matlab = content[: len(SIGNATURE)].tobytes() == SIGNATURE
    with bounded.undamaged(path):
        if is_matlab and content[512:520].tobytes() != HDF5_SIGNATURE:
            yield _stack(_of_version_5(path, content), "mat", name)
            return
        with bounded.opened_hdf5(path) as file:
            is_matlab = is_matlab or path.suffix.lower() == ".mat"
            yield _stack(_of_hdf5(file, name), "mat" if is_matlab else "hdf5", name)


def _of_version_5(path: Path, content: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
    """Return arrays of numbers in reverse order of axes; none is unpacked to more than stated."""
    unpacked, at, total = [content[:_HEAD_BYTES].tobytes()], _HEAD_BYTES, content.size
    if unpacked[0][-2:] != b"IM":
        raise ValueError("no little-endian file of version 5 or 7.3")
    bounded.check_decoded(path, (total,), 4)
    while at + 8 <= content.size:
        kind, length = content[at : at + 8].view("<u4").tolist()
        variable, at = content[at : at + 8 + length].tobytes(), at + 8 + length
        if kind == _COMPRESSED:
            stated = zlib.decompressobj().decompress(variable[8:], 8)[4:]
            size = 8 + int.from_bytes(stated, "little")
            total += size
            bounded.check_decoded(path, (total,), 4)
            variable = zlib.decompressobj().decompress(variable[8:], size)
        bounded.check_count(path, "variables", len(unpacked), _MOST_VARIABLES)
        unpacked.append(variable)
    file: Any = io.BytesIO(b"".join(unpacked))
    names = [name for name, _, kind in scipy.io.whosmat(file) if kind.startswith(_NUMBERS)]
    read = scipy.io.loadmat(file, variable_names=names)
    return {name: read[name].T for name in names if read[name].dtype.kind in "buif"}


def _of_hdf5(file: h5py.File, name: str | None) -> dict[str, Any]:
    """Return arrays, not read yet, and gate images as one."""
    if bounded.is_in(file, "events"):
        raise DamagedFileError("holds events, no frames; use read_events")
    arrays: dict[str, Any] = {}
    if bounded.is_in(file, _GATES):
        gates = sorted(file[_GATES], key=lambda gate: natural_key(Path(gate)))
        images = [bounded.dataset_in(file, f"{_GATES}/{gate}", "ui", 2, 16) for gate in gates]
        bounded.check_decoded(file.filename, (sum(image.size for image in images),), 16)
        arrays[_GATES] = np.stack([image[()] for image in images])
    for key in (*file, *filter(None, [name])):
        if bounded.is_in(file, key) and isinstance(file[key], h5py.Dataset):
            axes, is_single = file[key].ndim, file[key].size == 1
            if file[key].dtype.kind in "buif" and (axes in (2, 3) or is_single):
                at_once = 1 if axes == 3 else None
                arrays[key] = bounded.dataset_in(file, key, "buif", axes, 8, at_once)
    return arrays


def _stack(arrays: Mapping[str, Any], source: str, name: str | None) -> Stack:
    stacks = [key for key in arrays if arrays[key].ndim == 3 and len(arrays[key]) > 1]
    # a single frame has at least 64 pixels
    images = [key for key in arrays if arrays[key].ndim in (2, 3) and arrays[key].size >= 64]
    chosen = [name] if name else stacks or images
    if len(chosen) != 1 or chosen[0] not in arrays:
        listed = ", ".join(bounded.quoted(key, 40) for key in [*arrays][:9]) or "none"
        raise DamagedFileError(f"its arrays are {listed}; state the frames' by variable: NAME")
    single = {key: np.ravel(array[()])[0] for key, array in arrays.items() if array.size == 1}
    array = arrays[chosen[0]]
    array = array[()][np.newaxis] if array.ndim == 2 else array

    def read(part: slice) -> NDArray[Any]:
        numbers = np.asarray(array[part])
        numbers = numbers.swapaxes(1, 2) if source == "mat" else numbers
        if numbers.dtype.kind != "f":
            return numbers
        if not (numbers == np.floor(numbers)).all() or numbers.min(initial=0) < 0:
            raise DamagedFileError("its numbers are no counts; give the camera's, uncorrected")
        return numbers.astype(np.uint8 if numbers.max(initial=0) < 2**8 else np.uint32)

    stated = conditions_in("\n".join(f"{key}={value:g}" for key, value in single.items()))
    frame_bytes = 16.0 * array.shape[1] * array.shape[2]
    return Stack(source, len(array), frame_bytes, read, conditions=stated)
