import numpy as np
import pytest
import zarr

from megalopta.sensor import StoredCounts, counts_store, expose_rate, preset, read_counts
from megalopta.sensor.counts_store import write_counts


@pytest.fixture
def stored():
    sensor = preset("spadcam")
    exposure = expose_rate(np.linspace(0, 5e3, 720).reshape(5, 12, 12), sensor, seed=3, sequence=0)
    return StoredCounts(exposure, sensor, 3, "forest/0", 1e-3, {"speed": [1, 2.5], "note": "µ"})


def test_everything_comes_back_as_it_was_written(tmp_path, stored):
    write_counts(tmp_path / "a" / "spadcam.zarr", stored)
    back = read_counts(tmp_path / "a" / "spadcam.zarr")
    for name in ("counts", "expected", "saturated"):
        before, after = getattr(stored.exposure, name), getattr(back.exposure, name)
        assert after.dtype == before.dtype
        np.testing.assert_array_equal(after, before)
    for name in ("sensor", "seed", "sequence", "illuminance_lux", "extra"):
        assert getattr(back, name) == getattr(stored, name)


def test_store_is_zarr_v3_in_chunks_of_whole_frames(tmp_path, stored, monkeypatch):
    monkeypatch.setattr(counts_store, "_CHUNK_BYTES", 12 * 12 * 2 * 2)
    write_counts(tmp_path / "s.zarr", stored)
    group = zarr.open_group(tmp_path / "s.zarr", mode="r")
    assert group.metadata.zarr_format == 3
    assert group["counts"].chunks == (2, 12, 12)
    assert group["expected"].chunks == (1, 12, 12)
    assert group.attrs["exposure_s"] == stored.sensor.exposure_s
    np.testing.assert_array_equal(group["counts"][...], stored.exposure.counts)


def test_interrupted_write_leaves_nothing(tmp_path, stored, monkeypatch):
    def interrupt(group, name, *_):
        if name == "saturated":
            raise KeyboardInterrupt
        group.create_array(name, shape=(1,), dtype="u2")

    monkeypatch.setattr(counts_store, "_write_frames", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_counts(tmp_path / "s.zarr", stored)
    assert list(tmp_path.iterdir()) == []


def test_existing_store_is_not_overwritten(tmp_path, stored):
    write_counts(tmp_path / "s.zarr", stored)
    with pytest.raises(FileExistsError, match=r"s\.zarr: exists already"):
        write_counts(tmp_path / "s.zarr", stored)
    assert [path.name for path in tmp_path.iterdir()] == ["s.zarr"]


def test_missing_store_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.zarr: no such counts store"):
        read_counts(tmp_path / "nothing.zarr")


def test_something_else_is_refused(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("hello")
    zarr.open_group(tmp_path / "other.zarr", mode="w")
    for name, message in (("folder", "not a"), ("file", "not a"), ("other.zarr", "not one of")):
        with pytest.raises(ValueError, match=message):
            read_counts(tmp_path / name)
