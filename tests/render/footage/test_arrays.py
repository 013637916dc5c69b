"""Arrays in files, with a unit."""

import numpy as np
import pytest

from megalopta.core.errors import UserError
from megalopta.render import open_footage
from megalopta.scenes.spectra.color import decode_srgb


def saved(path, values, name="a.npy"):
    (np.save if name.endswith("npy") else np.savez_compressed)(path / name, values)
    return path / name


@pytest.mark.parametrize("name", ["a.npy", "a.npz"])
@pytest.mark.parametrize(
    ("shape", "frames"), [((4, 6), 1), ((5, 4, 6), 5), ((4, 6, 3), 1), ((5, 4, 6, 3), 5)]
)
def test_shapes(tmp_path, name, shape, frames):
    values = np.random.default_rng(0).random(shape, np.float32)
    with open_footage(saved(tmp_path, values, name), "linear") as footage:
        assert (len(footage), footage.shape, footage.times_s) == (frames, (4, 6), None)
        last = values.reshape(frames, 4, 6, -1)[-1]
        np.testing.assert_array_equal(footage.frame(frames - 1), np.broadcast_to(last, (4, 6, 3)))
        assert footage.saturated(0) == 0


@pytest.mark.parametrize("dtype", ["u1", "<u2", ">u2"])
@pytest.mark.parametrize(
    ("unit", "light", "told"),
    [
        (
            "srgb",
            lambda share, code: np.where(
                share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4
            ),
            "sRGB",
        ),
        ("linear", lambda share, code: share, "linear"),
        ("cd/m2", lambda share, code: code, "cd/m²"),
    ],
)
def test_whole_numbers_are_codes_of_the_unit(tmp_path, dtype, unit, light, told):
    top = np.iinfo(np.dtype(dtype)).max
    codes = np.array([[0, 1, 100, top - 1, top, top]], dtype)
    with open_footage(saved(tmp_path, codes), unit) as footage:
        expected = light(codes[0] / top, codes[0].astype(float))
        np.testing.assert_allclose(footage.frame(0)[0, :, 1], expected, rtol=1e-6)
        np.testing.assert_allclose(footage.mean(0), expected.mean(), rtol=1e-6)
        assert footage.saturated(0) == pytest.approx(2 / 6)
        assert (footage.transfer, footage.unit) == (told, unit)


def test_coded_floats_lie_between_0_and_1(tmp_path):
    codes = np.array([[0, 51, 255]], np.uint8)
    with open_footage(saved(tmp_path, codes / 255), "srgb") as footage:
        np.testing.assert_allclose(footage.frame(0)[..., 0], decode_srgb(codes), rtol=1e-6)
    with (
        open_footage(saved(tmp_path, codes / 1.0), "srgb") as footage,
        pytest.raises(UserError, match="between 0 and 1"),
    ):
        footage.frame(0)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.zeros((5, 4, 6, 4)), "has the shape (5, 4, 6, 4)"),
        (np.zeros((4, 6, 4)), "has the shape (4, 6, 4)"),
        (np.zeros((0, 4, 6)), "has the shape (0, 4, 6)"),
        (np.zeros(5), "has the shape (5,)"),
        (np.zeros((4, 6), np.int64), "holds int64"),
        (np.zeros((4, 6), complex), "holds complex128"),
        (np.array([[{}]]), "is not a complete array of numbers"),
    ],
)
def test_other_arrays_are_refused(tmp_path, values, said):
    with pytest.raises(UserError) as refusal:
        open_footage(saved(tmp_path, values), "linear")
    assert said in str(refusal.value) and "a.npy" in str(refusal.value)


def test_files_that_are_damaged_or_hold_several_arrays_are_refused(tmp_path):
    path = saved(tmp_path, np.zeros((40, 60)))
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(UserError, match="complete array"):
        open_footage(path, "linear")
    np.savez(tmp_path / "two.npz", a=np.zeros((4, 4)), b=np.zeros((4, 4)))
    with pytest.raises(UserError, match="holds 2 arrays"):
        open_footage(tmp_path / "two.npz", "linear")
    (tmp_path / "bad.npz").write_bytes(b"PK hello")
    with pytest.raises(UserError, match="complete array"):
        open_footage(tmp_path / "bad.npz", "linear")
