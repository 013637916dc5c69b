"""Single pictures and folders of them, which the tests write."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from megalopta.render import open_footage
from megalopta.scenes.spectra.color import linear_of_srgb

from .conftest import assert_mean_of_frame, chunk, exr, refused


def light_of(path, unit=None):
    with open_footage(path, unit) as footage:
        return footage.frame(0)


@pytest.fixture
def codes():
    return np.random.default_rng(3).integers(0, 256, (12, 20, 3)).astype(np.uint8)


@pytest.mark.parametrize("suffix", ["png", "bmp", "ppm", "webp"])
def test_a_picture_of_8_bits_is_one_frame_of_light(tmp_path, codes, suffix):
    Image.fromarray(codes).save(tmp_path / f"a.{suffix}", lossless=True)
    with open_footage(tmp_path / f"a.{suffix}") as footage:
        light = footage.frame(0)
        assert (len(footage), footage.shape, footage.times_s) == (1, (12, 20), None)
        assert (footage.coding.name, footage.coding.unit, footage.notes) == ("sRGB", "srgb", ())
        assert light.dtype == np.float32 and light.flags.c_contiguous
        np.testing.assert_allclose(light, linear_of_srgb(codes / 255), rtol=1e-6)
        assert_mean_of_frame(footage)
        assert footage.saturated(0) == pytest.approx((codes == 255).any(-1).mean(), abs=1e-12)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_of_exif(tmp_path, orientation):
    upright = np.zeros((8, 16), np.uint8)
    upright[:2, :6] = 255
    # ways to store it so that a viewer who follows Exif sees it upright
    stored = {1: upright, 2: upright[:, ::-1], 3: upright[::-1, ::-1], 4: upright[::-1], 5: upright.T,
              6: np.rot90(upright), 7: upright[::-1, ::-1].T, 8: np.rot90(upright, -1)}[orientation]  # fmt: skip
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(np.ascontiguousarray(stored)).save(tmp_path / "a.png", exif=exif)
    np.testing.assert_array_equal(light_of(tmp_path / "a.png")[..., 0] == 1, upright == 255)


def test_all_16_bits_are_kept(tmp_path):
    deep = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    cv2.imwrite(str(tmp_path / "a.png"), np.dstack([deep, deep.T, deep[::-1]]))  # blue first
    share = np.arange(65536).reshape(256, 256) / 65535
    light = light_of(tmp_path / "a.png", "linear")
    np.testing.assert_allclose(light, np.dstack([share[::-1], share.T, share]), atol=1e-7)
    coded = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    with open_footage(tmp_path / "a.png") as footage:
        np.testing.assert_allclose(footage.frame(0)[..., 2], coded, rtol=1e-6)
        np.testing.assert_allclose(footage.mean(0), coded.mean(), rtol=1e-7)
        assert footage.saturated(0) == pytest.approx(2 / 65536, rel=1e-9)


def test_transparency_stands_before_black(tmp_path, codes):
    alpha = np.full((12, 20), 255, np.uint8)
    alpha[:, :10] = 0
    deep = np.dstack([codes[..., ::-1], alpha]).astype(np.uint16) * 257
    cv2.imwrite(str(tmp_path / "a.png"), deep)
    with open_footage(tmp_path / "a.png") as footage:
        light = footage.frame(0)
        assert not light[:, :10].any()
        np.testing.assert_allclose(light[:, 10:], linear_of_srgb(codes[:, 10:] / 255), rtol=1e-6)
        assert footage.notes == ("transparent parts are shown over black",)


def test_light_of_exr_and_radiance(tmp_path):
    light = np.random.default_rng(5).gamma(1, 2, (12, 20, 3)).astype(np.float32)
    red, green, blue = np.moveaxis(light, 2, 0).copy()
    exr(tmp_path / "a.exr", {"R": red, "G": green, "B": blue})
    exr(tmp_path / "gray.exr", {"Y": red.astype(np.float16)})
    cv2.imwrite(str(tmp_path / "a.hdr"), light[..., ::-1])
    for name, tolerance in (("a.exr", 0), ("a.hdr", 0.05)):
        with open_footage(tmp_path / name) as footage:
            np.testing.assert_allclose(footage.frame(0), light, rtol=tolerance, atol=tolerance)
            assert footage.coding.name == footage.coding.unit == "linear"
            assert footage.saturated(0) == 0
            assert_mean_of_frame(footage, 1e-7)
    np.testing.assert_allclose(light_of(tmp_path / "gray.exr")[..., 2], red, rtol=1e-3)
    with open_footage(tmp_path / "a.exr", "cd/m2") as footage:
        assert (footage.coding.name, footage.coding.unit) == ("cd/m²", "cd/m2")


def test_light_below_zero(tmp_path):
    values = np.ones((10, 10), np.float32)
    values[0, 0] = -0.1
    exr(tmp_path / "a.exr", {"Y": values})
    with open_footage(tmp_path / "a.exr") as footage:
        assert footage.frame(0).min() == 0 and "slightly below 0" in footage.notes[0]
    values[:5] = -1
    assert "instead of differences" in refused(exr(tmp_path / "bad.exr", {"Y": values}))
    values[:] = np.nan
    assert "not finite" in refused(exr(tmp_path / "nan.exr", {"Y": values}))


def test_what_is_no_picture_is_refused(tmp_path, codes, capfd):
    deep = tmp_path / "deep.png"
    cv2.imwrite(
        str(deep), np.random.default_rng(0).integers(0, 65536, (64, 64, 3)).astype(np.uint16)
    )
    Image.fromarray(codes).save(tmp_path / "a.jpg")
    cv2.imwrite(str(tmp_path / "a.hdr"), np.random.default_rng(0).random((64, 64, 3), np.float32))
    head = struct.pack(">IIBBBBB", 2**30, 2**30, 16, 0, 0, 0, 0)
    huge = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")
    for name, content, said in (
        ("cut.png", deep.read_bytes()[:3000], "cannot be read as a picture"),
        ("cut.jpg", (tmp_path / "a.jpg").read_bytes()[:-200], "cannot be read as a picture"),
        ("cut.hdr", (tmp_path / "a.hdr").read_bytes()[:900], "cannot be read as a picture"),
        ("text.png", b"hello", "cannot be read as a picture"),
        ("huge.png", b"\x89PNG\r\n\x1a\n" + huge, "claims"),
        ("huge.hdr", b"#?RADIANCE\n\n-Y 999999999 +X 999999999\n", "takes 3e+10 GB"),
        ("deep.ppm", b"P6 2 2 65535\n" + bytes(24), "more than 8 bits"),
        ("empty.png", b"", "is empty"),
    ):
        (tmp_path / name).write_bytes(content)
        assert said in refused(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def folder_of(path, names, shape=(8, 8)):
    path.mkdir()
    for k, name in enumerate(names):
        Image.fromarray(np.full(shape, 10 * k, np.uint8)).save(path / name)
    return path


def test_pictures_of_a_folder_follow_the_numbers_in_their_names(tmp_path):
    folder = folder_of(tmp_path / "walk", ["f1.png", "f2.png", "f9.png", "f10.png", "f100.png"])
    (folder / "notes.txt").write_text("x")
    (folder / ".hidden.png").write_text("x")
    with open_footage(folder) as footage:
        names = [path.name for path in footage.files]
        assert names == ["f1.png", "f2.png", "f9.png", "f10.png", "f100.png"]
        np.testing.assert_array_equal(
            [footage.frame(k)[0, 0, 0] for k in range(5)],
            linear_of_srgb(np.arange(0, 50, 10) / 255).astype(np.float32),
        )
        assert footage.times_s is None
        left_out, order = footage.notes
        assert "notes.txt" in left_out and ".hidden" not in left_out
        assert "f1.png first, f100.png last" in order


def test_pictures_that_differ_are_refused_by_name(tmp_path, codes):
    folder = folder_of(tmp_path / "walk", ["f1.png", "f2.png"])
    Image.fromarray(codes).save(folder / "f3.png")
    message = refused(folder)
    assert "f1.png and f3.png differ in size (8 × 8 and 20 × 12 px)" in message
    Image.fromarray(np.zeros((8, 8), np.uint16)).save(folder / "f3.png")
    assert "f1.png and f3.png differ in bits" in refused(folder)
    (folder / "f3.png").unlink()
    Image.fromarray(codes).save(folder / "f3.jpg")
    assert "differ in kind" in refused(folder)
