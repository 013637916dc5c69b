import numpy as np
import pytest

from megalopta.core.errors import UserError
from megalopta.sensor.formats.packed import npy_writer
from megalopta.sensor.formats.reading import read_frames

from .scene import bits as draw

SPAD512 = draw(40, 512, 512)


@pytest.fixture
def npy(tmp_path):
    packed = np.packbits(SPAD512[:, :20, :37], axis=-1)
    with npy_writer(tmp_path / "a.npy", packed.shape) as write:
        write(packed)
    return tmp_path / "a.npy"


def test_npy_has_the_layout_of_visionsim(npy):
    array = np.load(npy)
    assert array.shape == (40, 20, 5)
    np.testing.assert_array_equal(np.unpackbits(array, axis=2, count=37), SPAD512[:, :20, :37])
    found = read_frames(npy, shape=(20, 37), frames=slice(3, 8))
    np.testing.assert_array_equal(found.counts, SPAD512[3:8, :20, :37])
    assert (found.bit_depth, found.source, found.total) == (1, "packed_npy", 40)
    with pytest.raises(ValueError, match="frames 30 to 49 are requested; it has 40"):
        read_frames(npy, "packed_npy", frames=slice(30, 50))


@pytest.mark.parametrize("keep", [0, 3, 50, 100, 1000])
def test_cut_npy_is_one_sentence(npy, keep):
    npy.write_bytes(npy.read_bytes()[:keep])
    with pytest.raises(ValueError, match=r"a\.npy(: | is )"):
        read_frames(npy, "npy")


def test_the_footer_of_the_camera_is_left_out_and_frames_are_taken_across_files(tmp_path):
    content = np.packbits(SPAD512, axis=-1).tobytes()
    (tmp_path / "RAW00000.bin").write_bytes(content + b"DONE")
    (tmp_path / "RAW00001.bin").write_bytes(content)
    recorded = read_frames(tmp_path, frames=slice(38, 42))
    np.testing.assert_array_equal(recorded.counts, np.concatenate((SPAD512[38:], SPAD512[:2])))
    assert recorded.total == 80
    (tmp_path / "RAW00001.bin").write_bytes(content + b"tail")
    with pytest.raises(ValueError, match="not a whole number of frames"):
        read_frames(tmp_path)


def test_half_frames_of_swissspad2_begin_with_the_least_significant_bit(tmp_path):
    (tmp_path / "0.bin").write_bytes(np.packbits(SPAD512[:, :256], 2, "little").tobytes())
    recorded = read_frames(tmp_path / "0.bin", "swissspad2")
    np.testing.assert_array_equal(recorded.counts, SPAD512[:, :256])


def test_pickles_are_not_loaded(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[[{}]]], object), allow_pickle=True)
    with pytest.raises(ValueError, match="give plain numbers"):
        read_frames(tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("most", "how", "shape", "depth"),
    [
        (1, {}, (4, 6, 16), 1),
        (9, {"kind": "npy"}, (4, 6, 16), 8),
        (9, {"shape": (6, 16)}, (4, 6, 16), 8),
        (9, {"kind": "packed_npy"}, (4, 6, 128), 1),
        (9, {"shape": (6, 123)}, (4, 6, 123), 1),
        (9, {}, None, None),
    ],
)
def test_npy_of_8_bits_is_read_as_it_says_and_never_guessed(tmp_path, most, how, shape, depth):
    numbers = np.random.default_rng(0).integers(0, most + 1, (4, 6, 16), np.uint8)
    np.save(tmp_path / "a.npy", numbers)
    if shape is None:
        with pytest.raises(ValueError, match="state the format, packed_npy or npy"):
            read_frames(tmp_path / "a.npy", **how)
        return
    found = read_frames(tmp_path / "a.npy", **how)
    assert (found.counts.shape, found.bit_depth) == (shape, depth)
    if shape == numbers.shape:
        np.testing.assert_array_equal(found.counts, numbers)


@pytest.mark.parametrize("dtype", [np.uint16, np.uint8])
def test_frames_beyond_the_budget_are_refused_before_they_are_read(tmp_path, dtype):
    with (tmp_path / "a.binary.npy").open("wb") as file:
        header = {"descr": np.dtype(dtype).str, "fortran_order": False, "shape": (9, 20000, 20000)}
        np.lib.format.write_array_header_1_0(file, header)
        file.truncate(file.tell() + 9 * 20000**2 * np.dtype(dtype).itemsize)  # sparse
    with pytest.raises(UserError, match="GB of memory"):
        read_frames(tmp_path / "a.binary.npy")
