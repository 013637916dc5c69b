"""Films, which the tests encode themselves, against closed forms."""

import numpy as np
import pytest

from megalopta.core.errors import UserError
from megalopta.render import open_footage

from .conftest import assert_mean_of_frame, gray, refused

BT709 = {"color_trc": 1, "colorspace": 1, "color_primaries": 1, "color_range": 1}


def pq(code):
    m1, m2 = 0.1593017578125, 78.84375
    c1, c2, c3 = 0.8359375, 18.8515625, 18.6875
    root = code ** (1 / m2)
    return 10000 * (max(root - c1, 0) / (c2 - c3 * root)) ** (1 / m1) / 203


def hlg(code):
    bright = (np.exp((code - 0.55991073) / 0.17883277) + 0.28466892) / 12
    return code**2 / 3 if code <= 0.5 else bright


TRANSFERS = {
    **dict.fromkeys((1, 2, 6), ("BT.709", lambda v: ((v + 0.099) / 1.099) ** (1 / 0.45))),
    4: ("gamma 2.2", lambda v: v**2.2),
    5: ("gamma 2.8", lambda v: v**2.8),
    8: ("linear", lambda v: v),
    13: ("sRGB", lambda v: ((v + 0.055) / 1.055) ** 2.4),
    16: ("PQ", pq),
    18: ("HLG", hlg),
}


@pytest.mark.parametrize("number", TRANSFERS)
def test_light_of_a_gray_of_10_bits_by_closed_form(film, number):
    name, light = TRANSFERS[number]
    colors = {"color_trc": number, "colorspace": 9, "color_primaries": 9, "color_range": 1}
    path = film([gray(700, 10)], format="yuv420p10le", colors=colors)
    with open_footage(path) as footage:
        frame = footage.frame(0)
        assert footage.coding.name == name and footage.coding.unit == "srgb"
        np.testing.assert_allclose(frame, light((700 - 64) / 876), rtol=2e-4)
        assert_mean_of_frame(footage, 1e-6)


@pytest.mark.parametrize(
    ("code", "range_", "expected"),
    [(126, 1, 110 / 219), (126, 2, 126 / 255), (235, 1, 1.0), (16, 1, 0.0), (250, 1, 1.0)],
)
@pytest.mark.parametrize("format", ["yuv420p", "gray"])
def test_range_of_8_bits(film, code, range_, expected, format):
    kind = ("film.mp4", "libx264") if format == "yuv420p" else ("gray.mkv", "ffv1")
    planes = gray(code) if format == "yuv420p" else gray(code)[:1]
    colors = BT709 | {"color_trc": 8, "color_range": range_}
    path = film([planes], *kind, format, colors=colors)
    with open_footage(path) as footage:
        np.testing.assert_allclose(footage.frame(0), expected, atol=0.5 / 255)
        assert footage.saturated(0) == (expected == 1)


@pytest.mark.parametrize(
    ("matrix", "kr", "kb"), [(1, 0.2126, 0.0722), (5, 0.299, 0.114), (9, 0.2627, 0.0593)]
)
@pytest.mark.parametrize("bits", [8, 10])
def test_color_by_the_matrix_that_is_stated(film, matrix, kr, kb, bits):
    scale = 1 << (bits - 8)
    planes = np.full((48, 64), 126 * scale), 110 * scale, 150 * scale
    colors = BT709 | {"color_trc": 8, "colorspace": matrix}
    path = film([planes], format="yuv420p" if bits == 8 else "yuv420p10le", colors=colors)
    y, u, v = (126 - 16) / 219, (110 - 128) / 224, (150 - 128) / 224
    red, blue = y + 2 * (1 - kr) * v, y + 2 * (1 - kb) * u
    green = (y - kr * red - kb * blue) / (1 - kr - kb)
    with open_footage(path) as footage:
        np.testing.assert_allclose(
            footage.mean(0), [red, green, blue], atol=0.5 / 255 if bits == 8 else 1e-4
        )


def test_rows_tell_a_matrix_that_is_not_stated(film):
    found = []
    for shape in ((48, 64), (720, 720)):
        colors = {"color_trc": 8}
        path = film([(np.full(shape, 126), 110, 150)], f"{shape[0]}.mp4", colors=colors)
        with open_footage(path) as footage:
            found.append(footage.mean(0)[0] - 110 / 219)
    assert found == pytest.approx([1.402 * 22 / 224, 1.5748 * 22 / 224], abs=0.6 / 255)


def test_primaries_of_bt2020_become_those_of_bt709(film):
    colors = {"color_trc": 8, "colorspace": 9, "color_primaries": 9, "color_range": 1}
    path = film([(np.full((48, 64), 500), 512, 700)], format="yuv420p10le", colors=colors)
    y, v = (500 - 64) / 876, (700 - 512) / 896
    red, blue = y + 1.4746 * v, y
    green = (y - 0.2627 * red - 0.0593 * blue) / 0.678
    # ITU-R BT.2087 has the inverse of this matrix
    matrix = [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]
    expected = np.maximum(np.array(matrix) @ np.clip([red, green, blue], 0, 1), 0)
    with open_footage(path) as footage:
        np.testing.assert_allclose(footage.frame(0)[5, 5], expected, atol=3e-4)
        assert_mean_of_frame(footage, 1e-6)
        assert any("BT.2020" in note for note in footage.notes)


@pytest.mark.parametrize(
    ("format", "codec", "name"),
    [("yuv420p10le", "libx264", "a.mp4"), ("yuv444p12le", "ffv1", "a.mkv")],
)
def test_all_bits_are_kept(film, format, codec, name):
    bits = 10 if "10" in format else 12
    codes = np.repeat(np.arange(32) + (500 << (bits - 10)), 2)[None].repeat(48, 0)
    planes, linear = (codes, 1 << (bits - 1), 1 << (bits - 1)), BT709 | {"color_trc": 8}
    path = film([planes], name, codec, format, colors=linear)
    with open_footage(path) as footage:
        expected = (codes - (64 << (bits - 10))) / (876 << (bits - 10))
        np.testing.assert_allclose(footage.frame(0)[..., 1], expected, atol=2e-5)


def moving(count):
    return [gray(20 + 8 * k) for k in range(count)]


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("film.mp4", "libx264", {"g": "6", "bf": "2"}),
        ("film.mkv", "libx264", {"g": "6", "bf": "2", "x264-params": "open-gop=1"}),
        ("film.webm", "libvpx-vp9", {"g": "5"}),
        ("film.avi", "libx264", {"g": "6", "bf": "2"}),
        ("film.mov", "mpeg4", {"g": "6"}),
    ],
)
def test_any_order_gives_the_frames_of_playing_it(film, name, codec, options):
    with open_footage(film(moving(20), name, codec, options=options)) as footage:
        in_order = [footage.frame(k) for k in range(len(footage))]
        assert len(in_order) == 20
        levels = [each.mean() for each in in_order]
        assert levels == sorted(levels) and levels[0] < 0.02 < levels[-1]
        np.testing.assert_allclose(footage.times_s, np.arange(20) / 25, atol=6e-4)
        for k in (19, 3, 12, 11, 0, 7, 18, 6):
            np.testing.assert_array_equal(footage.frame(k), in_order[k])


def test_times_of_a_variable_frame_rate(film):
    stamps = [0, 40, 50, 170, 180, 1000]
    with open_footage(film(moving(6), stamps=stamps)) as footage:
        np.testing.assert_allclose(footage.times_s, np.array(stamps) / 1000, atol=1e-4)


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_a_portrait_stands_upright(film, degrees):
    codes = np.full((48, 64), 60)
    codes[:8, :8] = 200  # at the top left as stored
    with open_footage(film([(codes, 128, 128)], rotation=degrees)) as footage:
        upright = np.rot90(codes, degrees // 90)
        assert footage.shape == upright.shape
        np.testing.assert_array_equal(footage.frame(0)[..., 0] > 0.2, upright > 100)
        assert any(f"{degrees}°" in note for note in footage.notes)


def test_what_is_no_film_is_refused(tmp_path, film, capfd):
    whole = film(moving(20), container={"movflags": "faststart"}).read_bytes()
    for name, content, said in (
        ("text.mp4", b"hello\n" * 100, "cannot be read as a video"),
        (
            "list.mp4",
            b"#EXTM3U\n#EXTINF:10,\nfilm.mp4\n#EXT-X-ENDLIST\n",
            "cannot be read as a video",
        ),
        ("empty.mp4", b"", "is empty"),
        ("cut.mp4", whole[: len(whole) * 2 // 3], "ends too early"),
        ("headless.mp4", whole[40:], "cannot be read as a video"),
    ):
        (tmp_path / name).write_bytes(content)
        assert said in refused(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_an_encrypted_film_is_refused(film):
    key = {
        "encryption_scheme": "cenc-aes-ctr",
        "encryption_key": "76a6c65c5ea762046bd749a2e632ccbb",
        "encryption_kid": "a7e61c373e219033c21091fa607bf3b8",
    }
    assert "is encrypted" in refused(film(moving(3), container=key))


def test_a_damaged_frame_is_refused_when_it_is_asked_for(film, tmp_path):
    noise = np.random.default_rng(0).integers(16, 235, (12, 48, 64))
    path = film([(each, 128, 128) for each in noise], "film.mkv", options={"g": "1"})
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 3000] = bytes(3000)
    path.write_bytes(content)
    with open_footage(path) as footage, pytest.raises(UserError, match="cannot be decoded"):
        for k in range(len(footage)):
            footage.frame(k)
