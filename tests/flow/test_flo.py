import struct

import numpy as np
import pytest

from megalopta.flow.flo import read_flo, write_flo


def flow(shape=(5, 7)):
    return np.random.default_rng(0).normal(size=(*shape, 2)).astype(np.float32)


def test_undefined_flow_is_stored_as_1e10_and_read_as_nan(tmp_path):
    holed = flow()
    holed[1, 2] = np.nan
    holed[3, 4, 0] = np.nan
    write_flo(tmp_path / "a.flo", holed)
    stored = np.frombuffer((tmp_path / "a.flo").read_bytes(), "<f4", offset=12).reshape(5, 7, 2)
    assert (stored[[1, 3], [2, 4]] == np.float32(1e10)).all()
    read = read_flo(tmp_path / "a.flo")
    np.testing.assert_array_equal(np.isnan(read).all(axis=-1), np.isnan(holed).any(axis=-1))


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (lambda content: content[:8], "8 bytes: too short"),
        (lambda content: b"PIEX" + content[4:], "starts with b'PIEX'"),
        (lambda content: content[:4] + struct.pack("<ii", -7, 5) + content[12:], "claims -7 × 5"),
        (lambda content: content[:4] + struct.pack("<ii", 7, 0) + content[12:], "claims 7 × 0"),
        (lambda content: content[:4] + struct.pack("<ii", 2**31 - 1, 2**31 - 1), "claims"),
        (lambda content: content[:-1], "291 bytes, 7 × 5 px need 292"),
        (lambda content: content + b"\0", "293 bytes, 7 × 5 px need 292"),
    ],
)
def test_damaged_file_is_refused_with_what_is_wrong(tmp_path, damage, sentence):
    path = tmp_path / "a.flo"
    write_flo(path, flow())
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(ValueError, match=sentence):
        read_flo(path)


@pytest.mark.parametrize("value", [np.inf, -np.inf, 2e9])
def test_value_that_would_be_read_as_undefined_is_refused(tmp_path, value):
    wrong = flow()
    wrong[0, 0, 1] = value
    with pytest.raises(ValueError, match="keeps for undefined"):
        write_flo(tmp_path / "a.flo", wrong)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3), (0, 7, 2)])
def test_array_that_is_no_flow_is_refused(tmp_path, shape):
    with pytest.raises(ValueError, match=r"give \(H, W, 2\)"):
        write_flo(tmp_path / "a.flo", np.zeros(shape))


def test_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "a.flo"
    write_flo(path, flow())

    def broken(self, target):
        raise OSError("disk full")

    monkeypatch.setattr("pathlib.Path.replace", broken)
    with pytest.raises(OSError, match="disk full"):
        write_flo(path, 2 * flow())
    assert list(tmp_path.iterdir()) == [path]
    np.testing.assert_array_equal(read_flo(path), flow())
