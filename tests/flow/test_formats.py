"""Flow in files of .flo, KITTI and Spring, which OpenCV and h5py read without us."""

import os
import struct

import cv2
import h5py
import numpy as np
import pytest

from megalopta.core.errors import UserError
from megalopta.flow.formats import read_flo, read_flow, read_kitti_png, write_flo, write_kitti_png

from ..megalopta.harm import claiming


def some_flow(shape=(5, 7)):
    return np.random.default_rng(0).normal(size=(*shape, 2)).astype(np.float32)


def test_undefined_flow_is_stored_as_1e10_and_read_as_nan(tmp_path):
    holed = some_flow()
    holed[1, 2] = np.nan
    holed[3, 4, 0] = np.nan
    write_flo(tmp_path / "a.flo", holed)
    stored = np.frombuffer((tmp_path / "a.flo").read_bytes(), "<f4", offset=12).reshape(5, 7, 2)
    assert (stored[[1, 3], [2, 4]] == np.float32(1e10)).all()
    read = read_flo(tmp_path / "a.flo")
    np.testing.assert_array_equal(np.isnan(read).all(axis=-1), np.isnan(holed).any(axis=-1))


@pytest.fixture
def flow():
    values = np.random.default_rng(0).uniform(-40, 40, (5, 7, 2)).astype(np.float32)
    values[2, 3], values[0, 0] = np.nan, (512.5, 0)  # unknown, and more than a file holds
    return values


def test_kitti_png_is_what_opencv_reads_by_kittis_formula(flow, tmp_path):
    write_kitti_png(tmp_path / "f.png", flow)
    blue, green, red = cv2.split(cv2.imread(str(tmp_path / "f.png"), cv2.IMREAD_UNCHANGED))
    read = np.stack([(red - 2.0**15) / 64, (green - 2.0**15) / 64], axis=-1)
    known = blue == 1
    assert (~known).sum() == 2 and not known[2, 3] and not known[0, 0]
    assert np.abs(read - flow)[known].max() <= 1 / 128
    np.testing.assert_array_equal(read_kitti_png(tmp_path / "f.png")[known], read[known])
    assert np.isnan(read_kitti_png(tmp_path / "f.png")[2, 3]).all()


FLOW = np.random.default_rng(0).uniform(-50, 50, (6, 9, 2)).astype(np.float32)
# what KITTI's steps of 1/64 px hold exactly
FLOW = np.round(FLOW * 64).astype(np.float32) / 64
HOLE = (2, 3)
LARGE = (2**31 - 1, 2**31 - 1)


def write(path, flow):
    """Write a flow in the format of its suffix."""
    if path.suffix == ".flo":
        write_flo(path, flow)
    elif path.suffix == ".flo5":
        with h5py.File(path, "w") as file:
            file.create_dataset("flow", data=flow, compression="gzip")
    elif path.suffix == ".npy":
        np.save(path, flow)
    elif path.suffix == ".png":
        known = np.isfinite(flow).all(axis=-1)
        values = np.where(known[..., None], flow * 64 + 2**15, 0)
        image = np.dstack([known, values[..., 1], values[..., 0]]).astype(np.uint16)
        assert cv2.imwrite(str(path), image)
    else:
        three = np.dstack([flow, np.zeros(flow.shape[:2])]).astype("<f4")
        header = f"PF\n{flow.shape[1]} {flow.shape[0]}\n-1.0\n".encode()
        path.write_bytes(header + three[::-1].tobytes())


@pytest.mark.parametrize("suffix", ["flo", "flo5", "png", "pfm", "npy"])
def test_every_format_gives_the_same_flow_and_its_holes(tmp_path, suffix):
    holed = FLOW.copy()
    holed[HOLE] = np.nan
    write(tmp_path / f"a.{suffix}", holed)
    found = read_flow(tmp_path / f"a.{suffix}")
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, holed)


def test_a_png_that_claims_3_600_million_pixels_is_refused_in_a_moment(tmp_path):
    write(tmp_path / "a.png", FLOW)
    (tmp_path / "a.png").write_bytes(claiming((tmp_path / "a.png").read_bytes(), 60_000, 60_000))
    with pytest.raises(UserError, match="takes .*60000 × 60000 values"):
        read_flow(tmp_path / "a.png")


def test_flow_in_another_file_is_not_looked_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")  # whose opening would wait for ever
    with h5py.File(tmp_path / "a.flo5", "w") as file:
        file["flow"] = h5py.ExternalLink(str(tmp_path / "pipe"), "/flow")
    with pytest.raises(ValueError, match="flow is missing, or a link"):
        read_flow(tmp_path / "a.flo5")


@pytest.mark.parametrize("suffix", ["flo", "flo5", "png", "pfm", "npy"])
def test_damaged_files_are_refused_by_name(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    write(path, FLOW)
    whole = path.read_bytes()
    claims = [whole[:4] + struct.pack("<ii", *sides) + whole[12:] for sides in ((-7, 5), LARGE)]
    for damaged in (b"", whole[:5], whole[: len(whole) // 2], b"x" * 100, *claims):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=f"a.{suffix}"):
            read_flow(path)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        (np.zeros((3, 4)), "a.npy"),
        (np.zeros((3, 4, 2), complex), "a.npy"),
        (np.array(["a"]), "a.npy"),
        (np.array([{}], dtype=object), "a.npy"),  # a pickle is not opened
        (np.moveaxis(FLOW, -1, 0), r"float32 \(2, 6, 9\).*numpy.moveaxis\(flow, 0, -1\)"),
        (FLOW.astype(np.int16), r"int16 \(6, 9, 2\).*astype\('float32'\)"),
    ],
)
def test_arrays_that_are_no_flow_are_refused(tmp_path, values, told):
    np.save(tmp_path / "a.npy", values)
    with pytest.raises(ValueError, match=told):
        read_flow(tmp_path / "a.npy")
    with pytest.raises(ValueError, match=r"a.mat: flow is read from .flo"):
        read_flow(tmp_path / "a.mat")
