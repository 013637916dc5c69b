"""What files state about place, light, time and pixels is used, or told in a note."""

import struct
import zlib
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from megalopta.render import open_footage

from .conftest import chunk, exr, refused

PICTURE = np.arange(1, 13, dtype=np.float32).reshape(3, 4)
XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)
D65 = (0.3127, 0.3290)


def seen(path, unit=None):
    """Frames (T, H, W, channels), and all notes as one text."""
    with open_footage(path, unit) as footage:
        frames = np.stack([footage.frame(k) for k in range(len(footage))])
        known = str(path), "over black", "HDR"
        assert all(any(each in note for each in known) for note in footage.notes)
        return frames, " | ".join(footage.notes)


def rgb(value=PICTURE):
    return {name: np.ascontiguousarray(value, np.float32) for name in "RGB"}


def window(left, top, right, bottom):
    return np.array([left, top], np.int32), np.array([right, bottom], np.int32)


def test_light_in_xyz_stays_gray_and_its_green_is_converted(tmp_path):
    frames, note = seen(exr(tmp_path / "a.exr", rgb(), chromaticities=XYZ))
    np.testing.assert_allclose(frames[0], np.stack([PICTURE] * 3, -1), rtol=1e-6)
    assert "states its primaries" in note


@pytest.mark.parametrize(
    "given",
    [
        (0.1, 0.1, 0.2, 0.2, 0.3, 0.3, *D65),  # on a line
        (0.64, 0.33, 0.64, 0.33, 0.15, 0.06, *D65),  # red is green
        (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.9, 0.9),  # white outside
        (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3, 0.0),  # white without luminance
        (float("nan"),) * 8,
        (0.0,) * 8,
    ],
)
def test_primaries_without_colors_are_refused_with_their_values(tmp_path, given):
    message = refused(exr(tmp_path / "a.exr", rgb(), chromaticities=given))
    assert f"{given[0]:.4g}" in message and "primaries" in message


@pytest.mark.parametrize(
    ("stated", "told"),
    [
        ({"pixelAspectRatio": 2.0}, "2 times as wide as high"),
        ({"expTime": 0.5}, "expTime 0.5"),
        ({"isoSpeed": 800.0, "aperture": 2.8}, "isoSpeed 800"),
        ({"screenWindowWidth": 2.0}, "screenWindowWidth 2"),
        ({"lookModTransform": "night"}, "lookModTransform night"),
        ({"comments": "none", "owner": "me"}, ""),
    ],
)
def test_other_attributes_are_told(tmp_path, stated, told):
    _, note = seen(exr(tmp_path / "a.exr", rgb(), **stated))
    assert told in note and bool(told) == bool(note)


def test_the_luminance_of_white_makes_light_absolute(tmp_path):
    path = exr(tmp_path / "a.exr", rgb(), whiteLuminance=50.0)
    with open_footage(path) as footage:
        assert footage.coding.unit == "cd/m2" and footage.is_absolute
        np.testing.assert_allclose(footage.frame(0)[..., 0], 50 * PICTURE)


@pytest.mark.parametrize(
    ("channels", "told"),
    [
        ({"left.Y": 1, "right.Y": 9}, "right.Y"),
        ({"R": 1, "G": 1, "B": 1, "diffuse.R": 9, "diffuse.G": 9, "diffuse.B": 9}, "diffuse.R"),
        ({"beauty.Y": 1, "depth.Z": 9}, "depth.Z"),
        ({"R": 1, "G": 1, "B": 1, "S1.500,0nm": 9}, "S1.500,0nm"),
    ],
)
def test_layers_and_views_that_are_not_read_are_named(tmp_path, channels, told):
    planes = {name: np.full((3, 4), value, np.float32) for name, value in channels.items()}
    frames, note = seen(exr(tmp_path / "a.exr", planes))
    assert (frames == 1).all() and told in note


@pytest.mark.parametrize("channel", ["S0.{},0nm", "left.S0.{}nm"])
def test_spectra_of_other_renderers(tmp_path, channel):
    names = map(channel.format, (450, 500, 550))
    planes = {name: np.full((3, 4), k + 1, np.float32) for k, name in enumerate(names)}
    stated = {"spectralLayoutVersion": "1.0", "emissiveUnits": "W.m^-2.sr^-1"}
    path = exr(tmp_path / "a.exr", planes | rgb(), **stated)
    with open_footage(path) as footage:
        np.testing.assert_allclose(
            footage.bands_nm, [(425, 475), (475, 525), (525, 575)], atol=1e-5
        )
        np.testing.assert_array_equal(footage.frame(0)[0, 0], [1, 2, 3])
        assert footage.is_absolute
        assert [note for note in footage.notes if "W.m^-2.sr^-1" in note] == [*footage.notes]
        # mean of V(λ) of CIE 1924 from 525 to 575 nm
        assert footage.luminance_shares[2] == pytest.approx(683 * 50 * 0.946, rel=0.005)
    assert "omit the unit" in refused(path, "linear")


HALF = np.full((3, 8, 3), 0.5)


def hdr(path, lines="", size="-Y 3 +X 8", light=HALF):
    rows = np.full((*light.shape[:2], 4), 128, np.uint8)
    rows[..., :3] = np.rint(light * 256)
    path.write_bytes(f"#?RADIANCE\n{lines}\n{size}\n".encode() + rows.tobytes())
    return path


@pytest.mark.parametrize(
    ("lines", "factor", "told"),
    [
        ("", 1, ""),
        ("FORMAT=32-bit_rle_rgbe\n", 1, ""),
        ("EXPOSURE=2\n", 1 / 2, "divided by 2"),
        ("EXPOSURE=2\nEXPOSURE= 4\n", 1 / 8, "divided by 8"),
        ("COLORCORR=2 4 8\n", (1 / 2, 1 / 4, 1 / 8), "divided by 2, 4, 8"),
        ("EXPOSURE=.5\nCOLORCORR=2 2 2\n", 1, ""),
        ("FORMAT=32-bit_rle_xyze\n", 1, "primaries"),
        ("PRIMARIES=.708 .292 .17 .797 .131 .046 .3127 .329\n", 1, "primaries"),
        ("PRIMARIES=.64 .33 .3 .6 .15 .06 .3127 .329\n", 1, ""),
        ("PIXASPECT=.5\n", 1, "2 times as wide"),
        ("VIEW=-vtv -vp 0 0 0\n", 1, "VIEW"),
        ("SOFTWARE=x\n# EXPOSURE=9\n", 1, ""),
    ],
)
def test_the_header_of_radiance(tmp_path, lines, factor, told):
    frames, note = seen(hdr(tmp_path / "a.hdr", lines))
    np.testing.assert_allclose(frames[0, 0, 0], 0.5 * np.ones(3) * factor, rtol=1e-5)
    assert told in note and bool(told) == bool(note)


def test_what_is_not_supported_is_refused(tmp_path):
    turned = hdr(tmp_path / "a.hdr", size="+Y 9 +X 12", light=np.zeros((9, 12, 3)))
    assert "-Y … +X …" in refused(turned)
    narrow = png(tmp_path / "a.png", np.zeros((4, 6, 3), np.uint8), (b"cICP", bytes([1, 8, 0, 0])))
    assert "other than sRGB" in refused(narrow)
    stated = {"dataWindow": window(2, 1, 5, 3), "displayWindow": window(0, 0, 7, 4)}
    assert "displayWindow" in refused(exr(tmp_path / "a.exr", rgb(), **stated))
    planes = {f"S0.{nm},0nm": PICTURE for nm in (450, 500)}
    assert "W.m^-2" in refused(exr(tmp_path / "b.exr", planes, emissiveUnits="W.m^-2"))


def png(path, codes, *chunks):
    cv2.imwrite(str(path), codes)
    content = path.read_bytes()
    path.write_bytes(content[:33] + b"".join(chunk(*each) for each in chunks) + content[33:])
    return path


GAMMA = b"gAMA", struct.pack(">I", 100_000)
SRGB_CHRM = struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
BT2020_CHRM = struct.pack(">8I", 31270, 32900, 70800, 29200, 17000, 79700, 13100, 4600)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize(
    ("chunks", "light", "told"),
    [
        ([], 0.2140, ""),
        ([GAMMA], 0.5, ""),
        ([(b"gAMA", struct.pack(">I", 50_000))], 0.25, ""),
        ([(b"gAMA", struct.pack(">I", 45_455))], 0.5**2.2, ""),
        ([GAMMA, (b"sRGB", b"\0")], 0.2140, ""),
        ([(b"cHRM", SRGB_CHRM)], 0.2140, ""),
        ([(b"cHRM", BT2020_CHRM)], 0.2140, "primaries"),
        ([(b"cICP", bytes([1, 13, 0, 1]))], 0.2140, ""),
        ([(b"pHYs", struct.pack(">IIB", 100, 200, 0))], 0.2140, "2 times as wide"),
        ([(b"iCCP", b"x\0\0" + zlib.compress(bytes(200)))], 0.2140, "color profile"),
        ([(b"oFFs", struct.pack(">iiB", 5, 5, 0))], 0.2140, "oFFs"),
        ([(b"sTER", b"\0")], 0.2140, "sTER"),
    ],
)
def test_chunks_of_png(tmp_path, depth, chunks, light, told):
    top = np.iinfo(depth).max
    codes = np.full((4, 6, 3), round(top / 2), depth)
    frames, note = seen(png(tmp_path / "a.png", codes, *chunks))
    np.testing.assert_allclose(frames[0], light, rtol=0.02 if depth == np.uint8 else 5e-3)
    assert told in note and bool(told) == bool(note)


@pytest.mark.parametrize("suffix", ["jpg", "webp", "png"])
def test_exposure_and_position_of_photographs_are_told(tmp_path, suffix):
    exif = Image.Exif()
    exif[0x0112] = 1
    exif.get_ifd(0x8769)[0x829A] = TiffImagePlugin.IFDRational(1, 60)
    exif.get_ifd(0x8825)[1] = "N"
    Image.new("RGB", (8, 8), "gray").save(tmp_path / f"a.{suffix}", exif=exif)
    _, note = seen(tmp_path / f"a.{suffix}")
    assert "ExposureTime" in note and "GPS" in note


def test_pixels_of_a_film_that_are_not_square_and_other_films_are_told(tmp_path):
    path = tmp_path / "a.mkv"
    with av.open(path, "w") as container:
        streams = [container.add_stream("libx264", rate=25) for _ in range(2)]
        for stream in streams:
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
            stream.codec_context.sample_aspect_ratio = Fraction(4, 3)
        for stream in streams:
            frame = av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), "rgb24")
            container.mux(stream.encode(frame.reformat(format="yuv420p")))
            container.mux(stream.encode(None))
    _, note = seen(path)
    assert "1.333 times as wide" in note and "holds 2 films" in note
