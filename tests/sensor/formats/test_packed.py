import numpy as np
import pytest

from megalopta.core.errors import UserError
from megalopta.sensor.formats.packed import (
    PackedLayout,
    npy_writer,
    spad512_writer,
)
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


def test_spad512_writes_a_thousand_frames_a_file(tmp_path):
    frame = np.packbits(SPAD512[:1], axis=-1)
    with spad512_writer(tmp_path / "burst") as write:
        write(np.repeat(frame, 700, axis=0))
        write(np.repeat(frame, 301, axis=0))
    sizes = {path.name: path.stat().st_size for path in (tmp_path / "burst").iterdir()}
    assert sizes == {"RAW00000.bin": 1000 * 512 * 64, "RAW00001.bin": 512 * 64}
    found = read_frames(tmp_path / "burst", frames=slice(999, 1001))
    np.testing.assert_array_equal(found.counts, np.repeat(SPAD512[:1], 2, axis=0))
    assert found.total == 1001


def test_header_and_footer_are_left_out(tmp_path):
    content = b"head" + np.packbits(SPAD512, axis=-1).tobytes() + b"tail"
    (tmp_path / "RAW.bin").write_bytes(content)
    layout = PackedLayout(header_bytes=4, footer_bytes=4)
    np.testing.assert_array_equal(read_frames(tmp_path / "RAW.bin", layout=layout).counts, SPAD512)
    with pytest.raises(ValueError, match="not a whole number of frames"):
        read_frames(tmp_path / "RAW.bin")
    # the answer of the camera, which programs keep
    (tmp_path / "RAW.bin").write_bytes(content[4:-4] + b"DONE")
    np.testing.assert_array_equal(read_frames(tmp_path / "RAW.bin").counts, SPAD512)


@pytest.mark.parametrize(
    ("along", "order", "layout"),
    [
        (2, "little", PackedLayout(bit_order="lsb")),
        (1, "big", PackedLayout(packed_along="height")),
    ],
)
def test_bits_are_read_as_the_layout_says(tmp_path, along, order, layout):
    (tmp_path / "RAW.bin").write_bytes(np.packbits(SPAD512, along, order).tobytes())
    found = read_frames(tmp_path / "RAW.bin", layout=layout)
    np.testing.assert_array_equal(found.counts, SPAD512)


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
        (9, {"layout": PackedLayout()}, (4, 6, 128), 1),
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
