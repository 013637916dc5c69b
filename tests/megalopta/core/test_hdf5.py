"""Only plain numbers in the file itself are read, whatever a stranger's HDF5 file names."""

import h5py
import numpy as np
import pytest

from megalopta.core.bounded import numbers_in, opened_hdf5
from megalopta.core.errors import UserError

HOSTILE = {
    "external link": lambda file: file.__setitem__("a/b", h5py.ExternalLink("other.h5", "a/b")),
    "external link of the group": lambda file: file.__setitem__("a", h5py.ExternalLink("other.h5", "a")),
    "soft link": lambda file: (file.__setitem__("c", [1.0]), file.__setitem__("a/b", h5py.SoftLink("/c"))),
    "external storage": lambda file: file.create_dataset("a/b", (4,), "f8", external=[("raw", 0, 32)]),
    "object references": lambda file: file.create_dataset("a/b", (4,), h5py.ref_dtype),
    "region references": lambda file: file.create_dataset("a/b", (4,), h5py.regionref_dtype),
    "text": lambda file: file.create_dataset("a/b", data=["x", "y"]),
    "records": lambda file: file.create_dataset("a/b", data=np.zeros(4, "f8,i4")),
    "nothing": lambda file: file.create_dataset("a/b", data=h5py.Empty("f8")),
    "a group": lambda file: file.create_group("a/b"),
    "two axes": lambda file: file.create_dataset("a/b", (2, 2), "f8"),
    "plug-in": lambda file: file.create_dataset("a/b", data=np.zeros(4), chunks=(4,), compression=32008, allow_unknown_filter=True),
    "scale-offset": lambda file: file.create_dataset("a/b", (4,), "i4", chunks=(4,), scaleoffset=0),
}  # fmt: skip


def virtual(file):
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "a/b", (4,))
    file.create_virtual_dataset("a/b", layout)


@pytest.mark.parametrize("make", [*HOSTILE.values(), virtual], ids=[*HOSTILE, "virtual"])
def test_what_leads_elsewhere_or_is_no_array_is_refused(tmp_path, make):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["a/b"] = np.arange(4.0)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        try:
            make(file)
        except ValueError:  # this HDF5 cannot even write with a plug-in
            file.create_dataset("a/b", (4,), "f8", chunks=(4,), fillvalue=1.0)
            pytest.skip("no plug-in")
    with (
        opened_hdf5(tmp_path / "a.h5") as file,
        pytest.raises(ValueError, match="^a/b (is|needs) "),
    ):
        numbers_in(file, "a/b", "f", 1)


@pytest.mark.parametrize("how", [{"compression": "gzip"}, {"compression": "lzf"}, {}])
def test_plain_numbers_with_the_filters_of_h5py_are_read(tmp_path, how):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a/b", data=np.arange(4.0), chunks=(2,), shuffle=True, **how)
    with opened_hdf5(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(numbers_in(file, "a/b", "f", 1), np.arange(4.0))


@pytest.mark.parametrize(("shape", "chunks"), [((10**9,), (1000,)), ((10,), (2**29,))])
def test_size_is_checked_before_it_is_decoded(tmp_path, shape, chunks):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a/b", shape, "f8", chunks=chunks, maxshape=(None,), compression="gzip")
    with opened_hdf5(tmp_path / "a.h5") as file, pytest.raises(UserError, match="GB of memory"):
        numbers_in(file, "a/b", "f", 1)
