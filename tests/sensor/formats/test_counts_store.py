import json

import numpy as np
import pytest
import zarr

from megalopta.sensor import Expectation, Exposure, open_counts, preset
from megalopta.sensor.formats import counts_store
from megalopta.sensor.formats.counts_store import MOMENTS, READINGS, Origin, counts_writer
from megalopta.sensor.formats.products import PRODUCTS, product_path, product_stem

COUNTS, VALUES = np.arange(720, dtype="u2").reshape(5, 12, 12), np.random.default_rng(0)
EXPOSURE = Exposure(COUNTS, COUNTS > 700, Expectation(*VALUES.random((5, *COUNTS.shape))))
ORIGIN = Origin(
    sensor=preset("spadcam"), seed=3, sequence="forest/0", illuminance_lux=1e-3,
    extra={"speed": [1, 2.5], "note": "µ"},
)  # fmt: skip


def part(frames, exposure=EXPOSURE):
    moments = (getattr(exposure.expectation, name)[frames] for name in MOMENTS)
    return Exposure(exposure.counts[frames], exposure.saturated[frames], Expectation(*moments))


def write(path, *exposures):
    exposures = exposures or (EXPOSURE,)
    with counts_writer(path, ORIGIN, sum(len(exposure.counts) for exposure in exposures)) as add:
        for exposure in exposures:
            add(exposure)


def test_everything_comes_back_as_it_was_written(tmp_path):
    write(tmp_path / "a" / "spadcam.zarr")
    opened = open_counts(tmp_path / "a" / "spadcam.zarr")
    back = opened.exposure()
    for name in READINGS:
        assert getattr(back, name).dtype == getattr(EXPOSURE, name).dtype
        np.testing.assert_array_equal(getattr(back, name), getattr(EXPOSURE, name))
    for name in MOMENTS:
        after = getattr(back.expectation, name)
        assert after.dtype == np.float32
        np.testing.assert_array_equal(after, np.float32(getattr(EXPOSURE.expectation, name)))
    for name in ("sensor", "seed", "sequence", "illuminance_lux", "extra"):
        assert getattr(opened, name) == getattr(ORIGIN, name)


def test_store_is_zarr_v3_in_chunks_of_whole_frames(tmp_path, monkeypatch):
    monkeypatch.setattr(counts_store, "CHUNK_BYTES", 12 * 12 * 2 * 2)
    write(tmp_path / "s.zarr")
    group = zarr.open_group(tmp_path / "s.zarr", mode="r")
    assert group.metadata.zarr_format == 3
    assert group["counts"].chunks == (2, 12, 12)
    assert group["mean_reading"].chunks == (1, 12, 12)
    assert group.attrs["exposure_s"] == ORIGIN.sensor.exposure_s
    np.testing.assert_array_equal(group["counts"][...], EXPOSURE.counts)


def test_frames_are_read_by_slices_without_the_rest(tmp_path, monkeypatch):
    monkeypatch.setattr(counts_store, "CHUNK_BYTES", 1)
    write(tmp_path / "s.zarr")
    for name in READINGS + MOMENTS:  # of frame 4, nothing is left
        (tmp_path / "s.zarr" / name / "c/4/0/0").write_bytes(b"")
    opened = open_counts(tmp_path / "s.zarr")
    assert len(opened["counts"]) == 5
    assert opened["photons"].shape == (5, 12, 12)
    first, expected = opened.exposure(slice(1, 3)), part(slice(1, 3))
    np.testing.assert_array_equal(first.counts, expected.counts)
    mean = np.float32(expected.expectation.mean_reading)
    np.testing.assert_array_equal(first.expectation.mean_reading, mean)
    np.testing.assert_array_equal(opened["saturated"][[0, 2]], EXPOSURE.saturated[[0, 2]])
    with pytest.raises(
        ValueError, match=r"s\.zarr is missing or damaged .*; write the counts again"
    ):
        opened["counts"][3:]


def test_counts_without_expectation_are_stored_as_such(tmp_path):
    write(tmp_path / "s.zarr", Exposure(EXPOSURE.counts, EXPOSURE.saturated))
    opened = open_counts(tmp_path / "s.zarr")
    assert opened.exposure().expectation is None
    with pytest.raises(ValueError, match="holds no mean; give one of counts, saturated"):
        opened["mean"]
    with pytest.raises(ValueError, match="holds no photons; expose with expectation=True"):
        opened["photons"]


def test_frames_written_in_parts_are_the_same_bytes(tmp_path):
    write(tmp_path / "whole.zarr")
    write(tmp_path / "parts.zarr", *(part(slice(first, first + 1)) for first in range(5)))
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
def test_a_damaged_store_is_refused_in_one_sentence(tmp_path, damage):
    write(tmp_path / "s.zarr")
    change, detail = DAMAGE[damage]
    change(tmp_path / "s.zarr")
    sentence = rf"s\.zarr is missing or damaged .*{detail}.*; write the counts again"
    with pytest.raises(ValueError, match=sentence) as no:
        open_counts(tmp_path / "s.zarr").exposure()
    assert "\n" not in str(no.value)


def test_the_exposure_of_every_product_is_read_back(tmp_path):
    for product in PRODUCTS:
        path = product_path(tmp_path / "spad.fast-0.1lux.zarr", product)
        assert product_stem(path) == "spad.fast-0.1lux"


def test_what_is_no_store_or_there_already_is_named(tmp_path):
    (tmp_path / "folder").mkdir()
    zarr.open_group(tmp_path / "other.zarr", mode="w")
    for name, message in (("folder", "damaged"), ("other.zarr", "without counts")):
        with pytest.raises(ValueError, match=message):
            open_counts(tmp_path / name)
    with pytest.raises(FileNotFoundError, match=r"nothing\.zarr: no such counts store"):
        open_counts(str(tmp_path / "nothing.zarr"))
    with pytest.raises(FileExistsError, match=r"other\.zarr: already exists"):
        write(tmp_path / "other.zarr")
