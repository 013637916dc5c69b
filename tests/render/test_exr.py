import errno
from operator import attrgetter

import numpy as np
import OpenEXR
import pytest

from megalopta.render import Truth, read_radiance, read_truth, write_radiance, write_truth
from megalopta.render.exr import TRUTH_CHANNELS, read_channels, read_headers
from megalopta.render.truth.footprint import FlowSpread, Footprint
from megalopta.scenes.spectra.color import band_means, luminances
from megalopta.scenes.spectra.spectrum import SPECTRA

ORIGIN = (1000.0, -3.0, 1.0)
BANDS = ((900.0, 1000.0), (400.0, 450.5), (450.5, 500.0))


def some_truth(blur=None):
    rng = np.random.default_rng(3)
    h, w = 5, 7
    flow = rng.normal(size=(h, w, 2)).astype(np.float32)
    flow[0, 0] = np.nan
    hidden, shares = rng.random((4, h, w)) < 0.5, rng.random((6, h, w)).astype(np.float32)
    return Truth(
        depth=np.full((h, w), np.inf, np.float32),
        # As stored: a float32 about the origin.
        position=rng.normal(size=(h, w, 3)).astype(np.float32) + np.array(ORIGIN),
        normal=rng.normal(size=(h, w, 3)).astype(np.float32),
        object_id=rng.integers(0, 2**32, (h, w), dtype=np.uint32),
        kind_id=rng.integers(0, 9, (h, w), dtype=np.uint32),
        flow_forward=flow,
        flow_backward=-flow,
        occluded_forward=hidden[0],
        occluded_backward=hidden[1],
        out_of_view_forward=hidden[2],
        out_of_view_backward=hidden[3],
        footprint=Footprint(
            *shares[:2], FlowSpread(2 * flow, *shares[2:4]), FlowSpread(3 * flow, *shares[4:])
        ),
        blur=blur,
    )


def test_radiance_returns_bit_for_bit_and_its_header_states_unit_and_bands(tmp_path):
    radiance = (1e-9 * np.random.default_rng(1).random((5, 7, 3))).astype(np.float32)
    write_radiance(tmp_path / "deep/a.exr", radiance, BANDS, {"lux": "1"})
    read, bands = read_radiance(tmp_path / "deep/a.exr")
    assert read.tobytes() == radiance.tobytes()
    assert bands == BANDS
    with OpenEXR.File(str(tmp_path / "deep/a.exr"), separate_channels=True) as file:
        header = dict(file.header())
        types = {name: plane.pixels.dtype.name for name, plane in file.channels().items()}
    assert types.keys() >= {"R", "G", "B"} and types.pop("R") == types.pop("G") == "float16"
    assert {name for name, kind in types.items() if kind != "float32"} == {"B"}
    assert header["emissiveUnits"] == "W.m^-2.sr^-1.nm^-1"
    assert header["bandEdgesNm"] == "900.0-1000.0 400.0-450.5 450.5-500.0"
    assert header["lux"] == "1"


@pytest.mark.parametrize("scale", [1e-12, 1e-7, 1e4])
def test_viewers_see_a_picture_of_any_light(tmp_path, scale):
    path, bands = tmp_path / "a.exr", tuple((nm, nm + 10.0) for nm in range(380, 780, 10))
    gray = np.random.default_rng(1).uniform(0.2, 1, (8, 8, 1))
    light = (scale * gray * band_means([SPECTRA["D65"]], bands)).astype(np.float32)
    write_radiance(path, light, bands)
    stops, channels = read_headers(path)[0]["EV"], read_channels(path)[1]
    expected = light.astype(float) @ luminances(bands) / 683 * 2**stops
    assert 0.1 < np.median(expected) < expected.max() < 1.5
    for name in "RGB":  # D65 is neutral; CIE's V(λ) and its fit differ by up to 1 %
        np.testing.assert_allclose(channels[name], expected, rtol=0.02)


def test_infrared_is_gray_and_files_without_a_picture_are_read(tmp_path):
    path, bands = tmp_path / "a.exr", ((900.0, 1000.0), (1000.0, 1100.0))
    light = np.random.default_rng(1).random((5, 7, 2)).astype(np.float32)
    write_radiance(path, light, bands)
    header, channels = read_channels(path)
    for name in "RGB":
        np.testing.assert_allclose(channels.pop(name), light.mean(-1) * 2 ** header["EV"], 1e-3)
    stated = {"bandEdgesNm": header["bandEdgesNm"], "type": OpenEXR.scanlineimage}
    OpenEXR.File(stated, channels).write(str(path))
    read, edges = read_radiance(path)
    assert read.tobytes() == light.tobytes() and edges == bands


def test_truth_returns_bit_for_bit_with_nan_and_infinity(tmp_path):
    truth = some_truth()
    write_truth(tmp_path / "t.exr", truth, ORIGIN)
    assert [path.name for path in tmp_path.iterdir()] == ["t.exr"]  # none is left half written
    again = read_truth(tmp_path / "t.exr")
    for name in TRUTH_CHANNELS:
        before, after = (attrgetter(name)(record) for record in (truth, again))
        assert (after.dtype, after.tobytes()) == (before.dtype, before.tobytes()), name
    assert again.blur is None
    blur = np.random.default_rng(4).random((5, 7)).astype(np.float32)
    write_truth(tmp_path / "t.exr", some_truth(blur))
    assert read_truth(tmp_path / "t.exr").blur.tobytes() == blur.tobytes()


def test_foreign_broken_and_missing_files_are_refused_by_name(tmp_path):
    (tmp_path / "text.exr").write_text("hello")
    write_truth(tmp_path / "t.exr", some_truth())
    whole = (tmp_path / "t.exr").read_bytes()
    (tmp_path / "cut.exr").write_bytes(whole[:-50])
    with pytest.raises(ValueError, match=r"text\.exr cannot be read as EXR"):
        read_radiance(tmp_path / "text.exr")
    with pytest.raises(ValueError, match=r"cut\.exr cannot be read as EXR"):
        read_truth(tmp_path / "cut.exr")
    with pytest.raises(ValueError, match=r"t\.exr is not a spectral-radiance EXR"):
        read_radiance(tmp_path / "t.exr")
    with pytest.raises(FileNotFoundError, match=r"none\.exr"):
        read_truth(tmp_path / "none.exr")


def test_a_full_disk_is_an_error_of_the_system_that_names_the_file(tmp_path, monkeypatch):
    def fails(self, path):
        raise RuntimeError(f'Failed to write to "{path}". No space left on device.')

    monkeypatch.setattr(OpenEXR.File, "write", fails)
    with pytest.raises(OSError, match="No space left on device: .*a.exr'") as full:
        write_radiance(tmp_path / "a.exr", np.ones((2, 2, 1), np.float32), ((400, 500),))
    assert full.value.errno == errno.ENOSPC
    assert not list(tmp_path.iterdir())
