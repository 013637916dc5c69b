"""Arrays that SciPy and h5py wrote, as MATLAB has them."""

import struct
import zlib

import h5py
import numpy as np
import pytest
import scipy.io

from megalopta.core.errors import UserError
from megalopta.sensor.formats.reading import read_frames

COUNTS = np.random.default_rng(0).poisson(300, (12, 20, 37)).astype(np.uint16)
IN_MATLAB = np.moveaxis(COUNTS, 0, 2)  # (rows, columns, frames)


def matlab_73(path, **arrays):
    """As MATLAB writes it: a block of 512 bytes, axes in reverse, classes as attributes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in arrays.items():
            stored = array.astype(np.uint8) if array.dtype == bool else array
            data = file.create_dataset(name, data=stored.T, compression=stored.ndim > 2 or None)
            data.attrs["MATLAB_class"] = np.bytes_(
                "logical" if array.dtype == bool else str(array.dtype)
            )
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


def matlab_5(path, **arrays):
    scipy.io.savemat(path, arrays, do_compression=True)


WRITERS = pytest.mark.parametrize("write", [matlab_5, matlab_73])


@WRITERS
@pytest.mark.parametrize("most", [1, 255])
@pytest.mark.parametrize("dtype", ["bool", "u1", "u2", "f8", "f4"])
def test_frames_are_the_last_axis_of_matlab(tmp_path, write, dtype, most):
    most = 1 if dtype == "bool" else most
    frames = (IN_MATLAB % (most + 1)).astype(dtype)
    write(tmp_path / "a.mat", frames=frames, exposure=np.array([[1e-5]]))
    read = read_frames(tmp_path / "a.mat")
    np.testing.assert_array_equal(read.counts, COUNTS % (most + 1))
    assert (read.total, read.exposure_s) == (12, pytest.approx(1e-5))
    assert read.values == ("bits" if most == 1 and dtype != "u2" else "counts")
    part = read_frames(tmp_path / "a.mat", frames=slice(3, 5))
    np.testing.assert_array_equal(part.counts, COUNTS[3:5] % (most + 1))


@WRITERS
def test_a_sum_is_one_frame(tmp_path, write):
    write(tmp_path / "a.mat", total=IN_MATLAB[..., 0])
    np.testing.assert_array_equal(read_frames(tmp_path / "a.mat").counts, COUNTS[:1])


@WRITERS
def test_of_several_arrays_one_is_named(tmp_path, write):
    write(tmp_path / "a.mat", first=IN_MATLAB, second=IN_MATLAB + np.uint16(1))
    for variable in (None, "third"):
        with pytest.raises(UserError, match="its arrays are first, second; state the frames' by"):
            read_frames(tmp_path / "a.mat", variable=variable)
    second = read_frames(tmp_path / "a.mat", variable="second")
    np.testing.assert_array_equal(second.counts, COUNTS + 1)


def test_gate_images_of_alligator_are_frames_in_natural_order(tmp_path):
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        for gate, image in enumerate(COUNTS, 1):
            file.create_dataset(f"Gate Images/Gate {gate}", data=image, compression="gzip")
    np.testing.assert_array_equal(read_frames(tmp_path / "a.hdf5").counts, COUNTS)


def test_other_hdf5_has_frames_first(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data/frames"] = COUNTS
        file["frames"] = COUNTS
    np.testing.assert_array_equal(read_frames(tmp_path / "a.h5").counts, COUNTS)
    nested = read_frames(tmp_path / "a.h5", variable="data/frames", frames=slice(1, 3))
    np.testing.assert_array_equal(nested.counts, COUNTS[1:3])


@WRITERS
@pytest.mark.parametrize("value", [0.5, -1.0, np.nan])
def test_fractions_are_no_counts(tmp_path, write, value):
    write(tmp_path / "a.mat", frames=np.full((9, 9, 3), value))
    with pytest.raises(UserError, match="no counts"):
        read_frames(tmp_path / "a.mat")


def objects(path):
    cell = np.array([np.zeros((9, 9, 3)), 1], object)
    scipy.io.savemat(path, {"cell": cell, "struct": {"frames": IN_MATLAB}, "text": "frames"})


def overstated(path):
    """A variable of which one element states 4 GB."""
    scipy.io.savemat(path, {"a": np.zeros((4, 4, 4), np.uint8)})
    content = bytearray(path.read_bytes())
    at = content.index(struct.pack("<II", 2, 64))
    struct.pack_into("<I", content, at + 4, 2**32 - 16)
    path.write_bytes(content)


def bomb(path):
    """A variable that states 4 GB, in a few bytes."""
    packed = zlib.compress(struct.pack("<II", 14, 2**32 - 16) + bytes(2**20))
    path.write_bytes(
        b"MATLAB 5.0".ljust(126) + b"IM" + struct.pack("<II", 15, len(packed)) + packed
    )


def links(path):
    with h5py.File(path, "w") as file:
        file["frames"] = h5py.ExternalLink("outside.h5", "frames")
        file["soft"] = h5py.SoftLink("/frames")


def large_chunk(path):
    shape = (10, 60_000, 60_000)
    with h5py.File(path, "w") as file:
        file.create_dataset("a", shape, "u1", chunks=(1, *shape[1:]), compression="gzip")


@pytest.mark.parametrize(
    ("harm", "told"),
    [
        (objects, "its arrays are none"),
        (bomb, "GB of memory"),
        (overstated, "missing or damaged"),
        (links, "its arrays are none"),
        (large_chunk, "GB of memory"),
        (lambda path: path.write_bytes(b"MATLAB 5.0" + bytes(200)), "no little-endian file"),
        (lambda path: path.write_bytes(b"MATLAB 5.0".ljust(126) + b"IM" + b"\x0f\0\0\0\x20\0\0\0junk"), "missing or damaged"),
    ],
)  # fmt: skip
def test_harm_is_one_sentence(tmp_path, harm, told):
    harm(tmp_path / "a.mat")
    with pytest.raises(UserError, match=told):
        read_frames(tmp_path / "a.mat")
