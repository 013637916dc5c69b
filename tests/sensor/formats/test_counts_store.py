import json
from dataclasses import replace

import numpy as np
import pytest
import zarr

from megalopta.sensor import (
    Expectation,
    Exposure,
    StoredCounts,
    expose,
    open_counts,
    preset,
    read_counts,
)
from megalopta.sensor.formats import counts_store
from megalopta.sensor.formats.counts_store import MOMENTS, READINGS, counts_writer, write_counts


@pytest.fixture
def stored():
    sensor = preset("spadcam")
    radiance = np.linspace(0, 1e-6, 720).reshape(5, 12, 12, 1)
    bands = [(400.0, 500.0)]
    exposure = expose(radiance, bands, sensor, seed=3, stream=0, expectation=True)
    return StoredCounts(
        exposure=exposure, sensor=sensor, seed=3, sequence="forest/0", illuminance_lux=1e-3,
        extra={"speed": [1, 2.5], "note": "µ"},
    )  # fmt: skip


def test_everything_comes_back_as_it_was_written(tmp_path, stored):
    write_counts(tmp_path / "a" / "spadcam.zarr", stored)
    back = read_counts(tmp_path / "a" / "spadcam.zarr")
    for name in READINGS:
        before, after = getattr(stored.exposure, name), getattr(back.exposure, name)
        assert after.dtype == before.dtype
        np.testing.assert_array_equal(after, before)
    for name in MOMENTS:
        before = getattr(stored.exposure.expectation, name)
        after = getattr(back.exposure.expectation, name)
        assert after.dtype == np.float32
        np.testing.assert_array_equal(after, before.astype(np.float32))
    for name in ("sensor", "seed", "sequence", "illuminance_lux", "extra"):
        assert getattr(back, name) == getattr(stored, name)


def test_store_is_zarr_v3_in_chunks_of_whole_frames(tmp_path, stored, monkeypatch):
    monkeypatch.setattr(counts_store, "CHUNK_BYTES", 12 * 12 * 2 * 2)
    write_counts(tmp_path / "s.zarr", stored)
    group = zarr.open_group(tmp_path / "s.zarr", mode="r")
    assert group.metadata.zarr_format == 3
    assert group["counts"].chunks == (2, 12, 12)
    assert group["mean_reading"].chunks == (1, 12, 12)
    assert group.attrs["exposure_s"] == stored.sensor.exposure_s
    np.testing.assert_array_equal(group["counts"][...], stored.exposure.counts)


def test_interrupted_write_leaves_nothing(tmp_path, stored):
    with (
        pytest.raises(KeyboardInterrupt),
        counts_writer(tmp_path / "s.zarr", stored, 2 * len(stored.exposure.counts)) as write,
    ):
        write(stored.exposure)
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def part(exposure, frames):
    moments = (getattr(exposure.expectation, name)[frames] for name in MOMENTS)
    return Exposure(exposure.counts[frames], exposure.saturated[frames], Expectation(*moments))


def test_frames_are_read_by_slices_without_the_rest(tmp_path, stored, monkeypatch):
    monkeypatch.setattr(counts_store, "CHUNK_BYTES", 1)
    write_counts(tmp_path / "s.zarr", stored)
    for name in READINGS + MOMENTS:  # of frame 4, nothing is left
        (tmp_path / "s.zarr" / name / "c/4/0/0").write_bytes(b"")
    opened = open_counts(tmp_path / "s.zarr")
    assert len(opened["counts"]) == 5
    assert opened["photons"].shape == (5, 12, 12)
    first, expected = opened.exposure(slice(1, 3)), part(stored.exposure, slice(1, 3))
    np.testing.assert_array_equal(first.counts, expected.counts)
    np.testing.assert_array_equal(opened["saturated"][[0, 2]], stored.exposure.saturated[[0, 2]])
    np.testing.assert_array_equal(
        opened.expectation([1, 2]).mean_reading,
        expected.expectation.mean_reading.astype(np.float32),
    )
    with pytest.raises(
        ValueError, match=r"s\.zarr is missing or damaged .*; write the counts again"
    ):
        opened["counts"][3:]


def test_mean_over_frames_is_that_of_the_whole(tmp_path, stored, monkeypatch):
    monkeypatch.setattr(counts_store, "CHUNK_BYTES", 12 * 12 * 2 * 2)
    write_counts(tmp_path / "s.zarr", stored)
    stored_counts = open_counts(tmp_path / "s.zarr")["counts"]
    assert stored_counts.mean() == pytest.approx(stored.exposure.counts.mean())


def test_counts_without_expectation_are_stored_as_such(tmp_path, stored):
    plain = Exposure(stored.exposure.counts, stored.exposure.saturated)
    write_counts(tmp_path / "s.zarr", replace(stored, exposure=plain))
    assert read_counts(tmp_path / "s.zarr").exposure.expectation is None
    with pytest.raises(ValueError, match="holds no mean; give one of counts, saturated"):
        open_counts(tmp_path / "s.zarr")["mean"]
    with pytest.raises(ValueError, match="holds no photons; expose with expectation=True"):
        open_counts(tmp_path / "s.zarr")["photons"]


def test_frames_written_in_parts_are_the_same_bytes(tmp_path, stored):
    write_counts(tmp_path / "whole.zarr", stored)
    exposure = stored.exposure
    with counts_writer(tmp_path / "parts.zarr", stored, len(exposure.counts)) as write:
        for first in range(len(exposure.counts)):
            write(part(exposure, slice(first, first + 1)))
    for path in (tmp_path / "whole.zarr").rglob("*"):
        twin = tmp_path / "parts.zarr" / path.relative_to(tmp_path / "whole.zarr")
        assert path.is_dir() or twin.read_bytes() == path.read_bytes()


def test_existing_store_is_not_overwritten(tmp_path, stored):
    write_counts(tmp_path / "s.zarr", stored)
    with pytest.raises(FileExistsError, match=r"s\.zarr: already exists"):
        write_counts(tmp_path / "s.zarr", stored)
    assert [path.name for path in tmp_path.iterdir()] == ["s.zarr"]


def test_missing_store_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.zarr: no such counts store"):
        read_counts(tmp_path / "nothing.zarr")


@pytest.mark.parametrize("part", ["mean_reading", "saturated"])
def test_store_that_lacks_an_array_is_refused_with_its_name(tmp_path, stored, part):
    write_counts(tmp_path / "s.zarr", stored)
    del zarr.open_group(tmp_path / "s.zarr")[part]
    with pytest.raises(
        ValueError,
        match=rf"s\.zarr is missing or damaged \(lacks '{part}'\); write the counts again",
    ):
        read_counts(tmp_path / "s.zarr")


def test_store_that_lacks_an_attribute_is_refused_with_its_name(tmp_path, stored):
    write_counts(tmp_path / "s.zarr", stored)
    del zarr.open_group(tmp_path / "s.zarr").attrs["seed"]
    with pytest.raises(ValueError, match=r"s\.zarr is missing or damaged \(lacks 'seed'\)"):
        read_counts(tmp_path / "s.zarr")


def tamper(path, **changes):
    values = json.loads(path.read_text())
    path.write_text(json.dumps({**values, **changes}))


@pytest.mark.parametrize("part", ["counts", "mean_reading", "saturated"])
@pytest.mark.parametrize(
    "changes",
    [
        {"shape": [5, 12, 13]},
        {"shape": [50_000_000, 12_000, 12_000]},
        {"shape": [5, 144]},
        {"shape": "wide"},
        {"data_type": "int8"},
        {"data_type": "complex64"},
        {"data_type": "string"},
        {"codecs": []},
        {"node_type": "group"},
        {"zarr_format": 9},
        {"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [0, 1, 1]}}},
    ],
)
def test_tampered_array_is_refused_in_one_sentence(tmp_path, stored, part, changes):
    write_counts(tmp_path / "s.zarr", stored)
    tamper(tmp_path / "s.zarr" / part / "zarr.json", **changes)
    with pytest.raises(
        ValueError, match=r"s\.zarr is missing or damaged .*; write the counts again"
    ) as no:
        read_counts(tmp_path / "s.zarr")
    assert "\n" not in str(no.value)


@pytest.mark.parametrize("part", ["", "counts", "photons"])
@pytest.mark.parametrize("keep", [0, 1, 100, -2])
def test_truncated_description_is_refused(tmp_path, stored, part, keep):
    write_counts(tmp_path / "s.zarr", stored)
    path = tmp_path / "s.zarr" / part / "zarr.json"
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(
        ValueError, match=r"s\.zarr is missing or damaged .*; write the counts again"
    ) as no:
        read_counts(tmp_path / "s.zarr")
    assert "\n" not in str(no.value)


def test_damaged_chunk_and_sensor_are_refused(tmp_path, stored):
    for name in ("a.zarr", "b.zarr"):
        write_counts(tmp_path / name, stored)
    chunk = next(path for path in (tmp_path / "a.zarr/counts/c").rglob("*") if path.is_file())
    chunk.write_bytes(chunk.read_bytes()[:9])
    zarr.open_group(tmp_path / "b.zarr").attrs["sensor"] = {"kind": "spad", "pitch_m": -1}
    for name in ("a.zarr", "b.zarr"):
        with pytest.raises(
            ValueError, match=rf"{name} is missing or damaged .*; write the counts again"
        ) as no:
            read_counts(tmp_path / name)
        assert "\n" not in str(no.value)


def test_paths_may_be_text_and_names_numpy_integers(tmp_path, stored):
    path = str(tmp_path / "s.zarr")
    write_counts(path, replace(stored, seed=np.int64(3), sequence=np.int32(4)))
    assert (read_counts(path).seed, read_counts(path).sequence) == (3, 4)


def test_something_else_is_refused(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("hello")
    zarr.open_group(tmp_path / "other.zarr", mode="w")
    for name, message in (
        ("folder", "damaged"),
        ("file", "damaged"),
        ("other.zarr", "without counts"),
    ):
        with pytest.raises(ValueError, match=message):
            read_counts(tmp_path / name)


@pytest.mark.parametrize("part", ["counts", "saturated", "photons"])
def test_a_lost_chunk_is_no_darkness(tmp_path, stored, part):
    write_counts(tmp_path / "s.zarr", stored)
    assert len(read_counts(tmp_path / "s.zarr").exposure.counts)
    (tmp_path / "s.zarr" / part / "c/0/0/0").unlink()
    with pytest.raises(
        ValueError, match=rf"chunks of {part} are missing\); write the counts again"
    ):
        open_counts(tmp_path / "s.zarr")
