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


def tamper(path, **changes):
    values = json.loads(path.read_text())
    path.write_text(json.dumps({**values, **changes}))


def group(path):
    return zarr.open_group(path, mode="r+")


def cut(path, keep):
    path.write_bytes(path.read_bytes()[:keep])


DAMAGE = {
    "array": (lambda store: group(store).__delitem__("saturated"), r"lacks 'saturated'"),
    "moment": (lambda store: group(store).__delitem__("mean_reading"), r"lacks 'mean_reading'"),
    "attribute": (lambda store: group(store).attrs.__delitem__("seed"), r"lacks 'seed'"),
    "sensor": (lambda store: group(store).attrs.update(sensor={"kind": "spad"}), ""),
    "lost chunk": (lambda store: (store / "counts/c/0/0/0").unlink(), "chunks of counts are miss"),
    "cut chunk": (lambda store: cut(store / "counts/c/0/0/0", 9), ""),
    **{
        f"{part or 'group'} cut to {keep}": (
            lambda store, part=part, keep=keep: cut(store / part / "zarr.json", keep), ""
        )
        for part in ("", "photons") for keep in (0, 100)
    },
    **{
        f"{part}: {changes}": (
            lambda store, part=part, changes=changes: tamper(store / part / "zarr.json", **changes), ""
        )
        for part in ("counts", "mean_reading")
        for changes in (
            {"shape": [5, 12, 13]}, {"shape": [50_000_000, 12_000, 12_000]}, {"shape": [5, 144]},
            {"shape": "wide"}, {"data_type": "int8"}, {"data_type": "string"}, {"codecs": []},
            {"node_type": "group"}, {"zarr_format": 9},
            {"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [0, 1, 1]}}},
        )
    },
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_store_is_refused_in_one_sentence(tmp_path, stored, damage):
    write_counts(tmp_path / "s.zarr", stored)
    change, detail = DAMAGE[damage]
    change(tmp_path / "s.zarr")
    sentence = rf"s\.zarr is missing or damaged .*{detail}.*; write the counts again"
    with pytest.raises(ValueError, match=sentence) as no:
        read_counts(tmp_path / "s.zarr")
    assert "\n" not in str(no.value)


def test_what_is_no_store_or_there_already_is_named(tmp_path, stored):
    (tmp_path / "folder").mkdir()
    zarr.open_group(tmp_path / "other.zarr", mode="w")
    for name, message in (("folder", "damaged"), ("other.zarr", "without counts")):
        with pytest.raises(ValueError, match=message):
            read_counts(tmp_path / name)
    with pytest.raises(FileNotFoundError, match=r"nothing\.zarr: no such counts store"):
        read_counts(str(tmp_path / "nothing.zarr"))
    with pytest.raises(FileExistsError, match=r"other\.zarr: already exists"):
        write_counts(tmp_path / "other.zarr", stored)
