"""Folders of recordings: what each is, and where its exposure and light are from."""

import h5py
import numpy as np
import pytest
import scipy.io
import tifffile
from PIL import Image

from megalopta.camera.sources import named_sources, read_recorded, recordings_in
from megalopta.core.errors import UserError
from megalopta.sensor import preset

from ..recordings import write_recording

BITS = (np.random.default_rng(0).random((5, 16, 24)) < 0.2).astype(np.uint8)


def pictures(folder, frames=255 * BITS, name=""):
    folder.mkdir(parents=True, exist_ok=True)
    for number, frame in enumerate(frames):
        Image.fromarray(frame).save(folder / f"{name}{number}.png")
    return folder


def of(sources):
    return [(source.path.name, source.exposure_s, source.light) for source in sources]


def test_folder_says_what_it_holds(tmp_path, capsys):
    pictures(tmp_path / "dark_10ms")
    pictures(tmp_path / "bright", name="bright_2e7_10us_")
    tifffile.imwrite(tmp_path / "flat-1e6-100us.tif", 9 * BITS)
    scipy.io.savemat(
        tmp_path / "a.mat", {"f": np.moveaxis(BITS, 0, 2), "exposure_us": 20, "light": 3e6}
    )
    (tmp_path / "notes.txt").write_text("")
    sources = named_sources([str(tmp_path)])
    assert of(sources) == [
        ("a.mat", pytest.approx(2e-5), 3e6),
        ("bright", pytest.approx(1e-5), 2e7),
        ("dark_10ms", 1e-2, 0),
        ("flat-1e6-100us.tif", 1e-4, 1e6),
    ]
    size = "5 frames × 16 rows × 24 columns"
    assert capsys.readouterr().err.splitlines() == [
        f"a.mat: mat, {size}, counts (as the others); exposure 20 µs (header), light 3e+06 (header)",
        f"bright: png, {size}, bits (all values are 0 or 255); exposure 10 µs (file's name), light 2e+07 (file's name)",
        f"dark_10ms: png, {size}, bits (all values are 0 or 255); exposure 10 ms (name), dark (name)",
        f"flat-1e6-100us.tif: tiff, {size}, counts (values up to 9); exposure 100 µs (name), light 1e+06 (name)",
    ]  # fmt: skip


def test_recordings_of_spadcam_are_found(tmp_path):
    codes = np.full((4, 16, 16), 3000, np.uint16)
    write_recording(tmp_path / "flat-2e8", preset("spadcam"), codes)
    assert of(named_sources([str(tmp_path)])) == [("flat-2e8", preset("spadcam").exposure_s, 2e8)]


@pytest.mark.parametrize(
    ("words", "settings", "exposure_s", "told"),
    [
        ("@2e7:1e-3", "exposure_s: 1.0e-4", 1e-3, "0.0001 (recording.yaml) contradicts 0.001 (stated)"),
        ("", "exposure_s: 1.0e-4", 1e-4, "1e-05 (name) contradicts 0.0001 (recording.yaml), which is taken"),
        ("", "", 1e-5, ""),
    ],
)  # fmt: skip
def test_statement_wins_over_yaml_over_name(tmp_path, capsys, words, settings, exposure_s, told):
    pictures(tmp_path / "flat_2e7_10us")
    if settings:
        (tmp_path / "flat_2e7_10us/recording.yaml").write_text(settings)
    (source,) = named_sources([f"{tmp_path}/flat_2e7_10us{words}"])
    assert (source.exposure_s, source.light) == (pytest.approx(exposure_s), 2e7)
    assert told in capsys.readouterr().err
    assert told in source.contradictions and bool(told) == bool(source.contradictions)


def test_header_wins_over_name(tmp_path, capsys):
    with h5py.File(tmp_path / "flat_2e7_10us.h5", "w") as file:
        file["frames"], file["exposure_ms"] = BITS, 20.0
    (source,) = named_sources([str(tmp_path / "flat_2e7_10us.h5")])
    assert source.exposure_s == pytest.approx(2e-2)
    assert "1e-05 (name) contradicts 0.02 (header), which is taken" in capsys.readouterr().err


def test_layout_next_to_raw_files_holds_for_all(tmp_path):
    for name in ("dark_1ms", "flat_1e5_1ms"):
        (tmp_path / f"{name}.bin").write_bytes(b"head" + np.packbits(BITS, 2, "little").tobytes())
    settings = "layout: {rows: 16, columns: 24, bit_order: lsb, header_bytes: 4}\nframes: [1, 4]\n"
    (tmp_path / "recording.yaml").write_text(settings)
    sources = named_sources([str(tmp_path)])
    for source in sources:
        np.testing.assert_array_equal(read_recorded(source).counts, BITS[1:4])


@pytest.mark.parametrize(
    ("names", "settings", "told"),
    [
        (["dark_1ms/"], "path: ../x", "path: unknown key"),
        (["dark_1ms/"], "layout: {order: lsb}", "layout"),
        (["dark_1ms/"], "[", "not valid YAML"),
        (["flat_2e7/"], "", "exposure is unknown; .*dark: @0:SECONDS.* as flat_2e7_10us"),
        (["flat_10us/"], "", "light is unknown"),
        (["dark_10us_", "flat_10us_"], "", "several recordings, dark_10us_0.png, flat"),
    ],
)
def test_unknown_keys_and_conditions_are_told_before_anything_is_read(
    tmp_path, names, settings, told
):
    for name in names:
        folder, _, start = f"./{name}".rpartition("/")
        pictures(tmp_path / folder, name=start)
        if settings:
            (tmp_path / folder / "recording.yaml").write_text(settings)
    with pytest.raises(UserError, match=told):
        named_sources([str(tmp_path)])


def test_zeros_and_ones_beside_counts_are_counts(tmp_path):
    pictures(tmp_path / "dark_1ms", BITS)
    pictures(tmp_path / "flat_1e5_1ms", 7 * BITS)
    dark, flat = named_sources([str(tmp_path)])
    assert not read_recorded(dark).is_binary and not read_recorded(flat).is_binary
    (alone,) = named_sources([str(tmp_path / "dark_1ms")])
    assert read_recorded(alone).is_binary


def test_links_are_refused(tmp_path):
    outside = pictures(tmp_path / "outside_10us")
    (tmp_path / "inside").mkdir()
    (tmp_path / "inside/dark_10us").symlink_to(outside)
    with pytest.raises(UserError, match="dark_10us: a link in a folder"):
        named_sources([str(tmp_path / "inside")])
    (tmp_path / "settings").write_text("exposure_s: 1")
    (outside / "recording.yaml").symlink_to(tmp_path / "settings")
    with pytest.raises(UserError, match="recording.yaml: a link"):
        named_sources([str(outside)])


@pytest.mark.parametrize("names", [["RAW00000", "RAW00001"], ["top1", "btm1"], ["1", "2", "10"]])
def test_parts_of_one_recording_are_one(tmp_path, names):
    for name in names:
        (tmp_path / f"{name}.bin").write_bytes(b"")
    assert recordings_in(tmp_path) == []
