import struct

import numpy as np
import pytest
import tifffile

from megalopta.sensor.formats.reading import read_frames
from megalopta.sensor.formats.recorded_frames import tiff_writer

from .scene import bits as draw


def spc3(counts, *, signed=0, frames=None, integration=1040, summed=3, pixels=None):
    """A file by the table in MPD's header, byte by byte; counts (T, counters, 32, columns)."""
    header = bytearray(1024)
    total, counters, rows, columns = counts.shape
    header[0:10] = b"camera 7  "
    header[100:104] = bytes([rows, columns, 8 * counts.itemsize, counters])
    header[104:108] = struct.pack("<HH", integration, summed)
    header[110:112] = struct.pack("<H", 150)
    header[113] = signed
    header[114:118] = struct.pack("<I", total if frames is None else frames)
    header[126:128] = struct.pack("<H", rows * columns if pixels is None else pixels)
    lines = np.swapaxes(counts, 2, 3)
    return bytes.fromhex("4d5044ff03000001") + header + lines.astype(counts.dtype).tobytes()


COUNTS = np.random.default_rng(0).integers(0, 60000, (5, 2, 32, 64)).astype("<u2")


@pytest.mark.parametrize("counter", [1, 2])
def test_spc3_gives_counts_of_a_counter_and_the_exposure(tmp_path, counter):
    (tmp_path / "a.spc3").write_bytes(spc3(COUNTS))
    found = read_frames(tmp_path / "a.spc3", counter=counter)
    np.testing.assert_array_equal(found.counts, COUNTS[:, counter - 1])
    assert (found.bit_depth, found.source) == (16, "spc3")
    assert found.exposure_s == pytest.approx(3 * 10.4e-6)


def test_spc3_of_eight_bits_may_be_signed(tmp_path):
    counts = np.random.default_rng(0).integers(-100, 100, (4, 1, 32, 32)).astype("i1")
    (tmp_path / "a.spc3").write_bytes(spc3(counts, signed=1))
    found = read_frames(tmp_path / "a.spc3", frames=slice(1, 3))
    np.testing.assert_array_equal(found.counts, counts[1:3, 0])
    assert found.total == 4


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (spc3(COUNTS)[:-1], "cut short"),
        (spc3(COUNTS)[:600], "cut short within its header"),
        (spc3(COUNTS, pixels=2016), "pixels 2016"),
        (spc3(COUNTS, integration=0), "integration_10ns 0"),
    ],
)
def test_damaged_spc3_is_one_sentence(tmp_path, content, message):
    (tmp_path / "a.spc3").write_bytes(content)
    with pytest.raises(ValueError, match=rf"a\.spc3: .*{message}"):
        read_frames(tmp_path / "a.spc3")


def test_swissspad2_whole_frames_are_put_together(tmp_path):
    bits = draw(12, 512, 512)
    lines = []
    for quarter in range(4):
        columns = slice(128 * quarter, 128 * quarter + 128)
        lines += [bits[:, :256, columns], bits[:, :255:-1, columns]]
    packed = np.packbits(np.concatenate(lines, axis=2), axis=2, bitorder="little")
    (tmp_path / "0.bin").write_bytes(packed.tobytes())
    found = read_frames(tmp_path, "swissspad2_whole")
    np.testing.assert_array_equal(found.counts, bits)


def test_swissspad2_counts_of_two_halves_are_put_together(tmp_path):
    counts = np.random.default_rng(0).integers(0, 256, (3, 512, 512)).astype("u1")
    raw = np.concatenate([counts[..., bank::4] for bank in range(4)], axis=2)  # four banks of 128
    for half, part in (("top", raw[:, :256]), ("btm", raw[:, :255:-1])):
        (tmp_path / f"{half}9.bin").write_bytes(part[:2].tobytes())
        (tmp_path / f"{half}10.bin").write_bytes(part[2:].tobytes())
    np.testing.assert_array_equal(read_frames(tmp_path).counts, counts)
    np.testing.assert_array_equal(read_frames(tmp_path, frames=slice(1, 3)).counts, counts[1:])
    (tmp_path / "top10.bin").unlink()
    with pytest.raises(ValueError, match="top and btm differ in files or frames"):
        read_frames(tmp_path)


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4", "f4"])
def test_tiff_comes_back(tmp_path, dtype):
    frames = np.random.default_rng(0).integers(0, 250, (7, 20, 30)).astype(dtype)
    with tiff_writer(tmp_path / "a.tiff", frames.nbytes, exposure_s=0.01) as write:
        write(frames[:3])
        write(frames[3:])
    found = read_frames(tmp_path / "a.tiff")
    assert found.counts.dtype == frames.dtype
    np.testing.assert_array_equal(found.counts, frames)
    assert found.exposure_s == 0.01
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.tiff"), frames)
    part = read_frames(tmp_path / "a.tiff", frames=slice(2, 5))
    np.testing.assert_array_equal(part.counts, frames[2:5])
    assert part.total == len(frames)


@pytest.mark.parametrize("options", [{"compression": "zlib"}, {"imagej": True}, {"bigtiff": True}])
def test_tiff_of_other_programs(tmp_path, options):
    frames = np.random.default_rng(0).integers(0, 250, (7, 20, 30)).astype("u2")
    tifffile.imwrite(tmp_path / "a.tif", frames, **options)
    np.testing.assert_array_equal(read_frames(tmp_path / "a.tif").counts, frames)


def test_damaged_tiff_is_one_sentence(tmp_path):
    frames = np.random.default_rng(0).integers(0, 250, (7, 20, 30)).astype("u2")
    with tiff_writer(tmp_path / "whole.tiff", frames.nbytes) as write:
        write(frames)
    whole = (tmp_path / "whole.tiff").read_bytes()
    for keep in (4, 8, 100, len(whole) // 2):
        (tmp_path / "a.tiff").write_bytes(whole[:keep])
        with pytest.raises(ValueError, match=r"a\.tiff(: | is )"):
            read_frames(tmp_path / "a.tiff")


def test_unknown_content_is_refused(tmp_path):
    (tmp_path / "a.dat").write_bytes(b"nothing that is known")
    with pytest.raises(ValueError, match="of no format that is known"):
        read_frames(tmp_path / "a.dat")
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_frames(tmp_path / "b.dat")
    (tmp_path / "empty.bin").write_bytes(b"")
    with pytest.raises(ValueError, match="is empty"):
        read_frames(tmp_path / "empty.bin")
