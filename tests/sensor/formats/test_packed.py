import numpy as np
import pytest

from megalopta.core.errors import UserError
from megalopta.sensor.formats.packed import Layout, npy_writer
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


def raw(folder, frames, order="big", header=b"", footer=b"", row_bytes=0):
    packed = np.packbits(frames, axis=2, bitorder=order)
    packed = np.pad(packed, ((0, 0), (0, 0), (0, max(row_bytes - packed.shape[2], 0))))
    (folder / "a.bin").write_bytes(header + packed.tobytes() + footer)
    return folder / "a.bin"


@pytest.mark.parametrize("order", ["msb", "lsb"])
def test_raw_bits_of_a_stated_layout(tmp_path, order):
    frames, written = SPAD512[:10, :50, :93], "big" if order == "msb" else "little"
    path = raw(tmp_path, frames, written, header=b"abc", footer=b"tail", row_bytes=16)
    stated = {"bit_order": order, "header_bytes": 3, "footer_bytes": 4, "row_bytes": 16}
    read = read_frames(path, layout=Layout(rows=50, columns=93, **stated), frames=slice(2, 7))
    np.testing.assert_array_equal(read.counts, frames[2:7])
    assert (read.source, read.total, read.bit_depth) == ("raw", 10, 1)


def test_pictures_are_turned_as_stated(tmp_path):
    frames = SPAD512[:3, :40, :64]
    path = raw(tmp_path, frames)
    for orientation, turned in (
        (["transposed", "upside_down"], np.rot90(frames, axes=(1, 2))),
        (["mirrored"], frames[:, :, ::-1]),
    ):
        layout = Layout(rows=40, columns=64, orientation=orientation)
        np.testing.assert_array_equal(read_frames(path, layout=layout).counts, turned)


@pytest.mark.parametrize("bits", [8, 16])
def test_raw_counts_of_a_stated_layout(tmp_path, bits):
    counts = np.random.default_rng(0).integers(0, 2**bits, (6, 10, 12)).astype(f"<u{bits // 8}")
    for number in (0, 1, 10):  # natural order
        (tmp_path / f"{number}.raw").write_bytes(b"head" + counts[[number % 9]].tobytes())
    layout = Layout(rows=10, columns=12, bits=bits, header_bytes=4)
    read = read_frames(tmp_path, layout=layout)
    np.testing.assert_array_equal(read.counts, counts[[0, 1, 1]])
    assert (read.bit_depth, read.total) == (bits, 3)


@pytest.mark.parametrize(("order", "other"), [("msb", "lsb"), ("lsb", "msb")])
def test_the_other_order_of_bits_is_told_by_the_columns(tmp_path, order, other):
    written = {"msb": "big", "lsb": "little"}
    path = raw(tmp_path, SPAD512, written[other])
    layout = Layout(rows=512, columns=512, bit_order=order)
    with pytest.raises(ValueError, match=f"period of 8.*bit_order: {other}"):
        read_frames(path, layout=layout)
    read_frames(raw(tmp_path, SPAD512, written[order]), layout=layout)


def test_columns_without_a_pattern_tell_no_order(tmp_path):
    """Flat light, hot pixels and efficiencies of columns, 60 cameras: 6 errors of 63 pairs of
    columns, a chance of 5e-8 each of a t distribution."""
    layout = Layout(rows=32, columns=512)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        rate = 0.2 * rng.lognormal(0, 0.2, 512) + 0.7 * (rng.random((32, 512)) < 0.03)
        frames = (rng.random((40, 32, 512)) < rate).astype(np.uint8)
        read_frames(raw(tmp_path, frames), layout=layout)


def test_raw_bits_without_a_layout_are_refused(tmp_path):
    with pytest.raises(ValueError, match="raw frames; state their layout"):
        read_frames(raw(tmp_path, SPAD512), "raw")
    with pytest.raises(ValueError, match="row_bytes 3 are less than 64 pixels"):
        read_frames(raw(tmp_path, SPAD512), layout=Layout(rows=4, columns=64, row_bytes=3))
