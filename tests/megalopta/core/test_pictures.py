"""Pictures of strangers."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from megalopta.core.errors import DamagedFileError
from megalopta.core.pictures import read_picture


def test_a_picture_that_claims_too_many_pixels_is_refused(tmp_path):
    Image.new("L", (2, 2)).save(tmp_path / "a.png")
    content = bytearray((tmp_path / "a.png").read_bytes())
    content[16:24] = struct.pack(">II", 60_000, 60_000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(DamagedFileError, match="too many pixels"):
        read_picture(tmp_path / "a.png", "L")


def test_sixteen_bits_are_refused_rather_than_clipped(tmp_path):
    Image.fromarray(np.full((2, 2), 40_000, np.uint16)).save(tmp_path / "a.png")
    with pytest.raises(DamagedFileError, match="more than 8 bits"):
        read_picture(tmp_path / "a.png", "L")


@pytest.mark.parametrize("content", [b"", b"x" * 100, b"%!PS-Adobe-3.0 EPSF-3.0\n"])
def test_what_is_no_picture_is_refused(tmp_path, content):
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(DamagedFileError, match="cannot be read as a picture"):
        read_picture(tmp_path / "a.png", "RGB")
