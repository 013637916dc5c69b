"""Flow in the files of KITTI and Spring, which OpenCV and h5py read without us."""

import cv2
import h5py
import numpy as np
import pytest

from megalopta.flow.files import read_flo5, read_kitti_png, write_flo5, write_kitti_png


@pytest.fixture
def flow():
    values = np.random.default_rng(0).uniform(-40, 40, (5, 7, 2)).astype(np.float32)
    values[2, 3] = np.nan
    return values


def test_kitti_png_is_what_opencv_reads_by_kittis_formula(flow, tmp_path):
    write_kitti_png(tmp_path / "f.png", flow)
    blue, green, red = cv2.split(cv2.imread(str(tmp_path / "f.png"), cv2.IMREAD_UNCHANGED))
    read = np.stack([(red - 2.0**15) / 64, (green - 2.0**15) / 64], axis=-1)
    known = blue == 1
    assert (~known).sum() == 1 and not known[2, 3]
    assert np.abs(read - flow)[known].max() <= 1 / 128
    np.testing.assert_array_equal(read_kitti_png(tmp_path / "f.png")[known], read[known])
    assert np.isnan(read_kitti_png(tmp_path / "f.png")[2, 3]).all()


def test_kitti_png_calls_unknown_what_it_cannot_hold(flow, tmp_path):
    flow[0, 0] = 512.5, 0
    write_kitti_png(tmp_path / "f.png", flow)
    assert np.isnan(read_kitti_png(tmp_path / "f.png")).all(axis=-1).sum() == 2


def test_flo5_is_hdf5_with_one_dataset(flow, tmp_path):
    write_flo5(tmp_path / "f.flo5", flow)
    with h5py.File(tmp_path / "f.flo5") as file:
        np.testing.assert_array_equal(file["flow"][()], flow)
    np.testing.assert_array_equal(read_flo5(tmp_path / "f.flo5"), flow)


@pytest.mark.parametrize("read", [read_flo5, read_kitti_png])
def test_something_else_is_refused_by_name(read, tmp_path):
    (tmp_path / "a.dat").write_bytes(b"something else")
    with pytest.raises(ValueError, match="a.dat"):
        read(tmp_path / "a.dat")
