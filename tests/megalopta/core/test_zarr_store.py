"""Stores of strangers: nothing in them runs, leads elsewhere or grows beyond what it states."""

import gzip
import json
import pickle

import numpy as np
import pytest
import zarr
from numcodecs import Zstd, blosc
from zarr.codecs import BloscCodec, GzipCodec, ZstdCodec

from megalopta.core.bounded import open_array, open_store, undamaged
from megalopta.core.errors import UserError

from ..harm import as_format_2

NUMBERS = np.arange(24, dtype=np.uint16).reshape(4, 2, 3)


@pytest.fixture
def store(tmp_path):
    group = zarr.open_group(tmp_path / "s.zarr", mode="w", attributes={"unit": "counts"})
    group.create_array("counts", data=NUMBERS, chunks=(2, 2, 3))
    return tmp_path / "s.zarr"


def said(change):
    """Other metadata of the array."""

    def put(store, outside):
        path = store / "counts" / "zarr.json"
        values = json.loads(path.read_text())
        change(values)
        path.write_text(json.dumps(values))

    return put


def codecs(*names):
    return said(lambda values: values.update(codecs=[{"name": name} for name in names]))


def consolidated(name, **fields):
    """Metadata of the group that differ from those of the array."""

    def put(store, outside):
        path = store / "zarr.json"
        values = json.loads(path.read_text())
        array = json.loads((store / "counts" / "zarr.json").read_text()) | fields
        inside = {"kind": "inline", "must_understand": False, "metadata": {name: array}}
        path.write_text(json.dumps(values | {"consolidated_metadata": inside}))

    return put


def linked(name):
    def put(store, outside):
        (store / name).rename(outside / "moved")
        (store / name).symlink_to(outside / "moved")

    return put


def in_shards(values):
    inner = {"chunk_shape": [1, 2, 3], "codecs": [{"name": "numcodecs.pickle"}], "index_codecs": []}
    values.update(codecs=[{"name": "sharding_indexed", "configuration": inner}])


HOSTILE = {
    "format 2": lambda store, outside: as_format_2(store, outside / "ran"),
    "format 2 beside": lambda store, outside: (store / "counts" / ".zarray").write_text("{}"),
    "group of format 2 beside": lambda store, outside: (store / ".zgroup").write_text("{}"),
    "pickle": codecs("bytes", "numcodecs.pickle"),
    "codec of a package": codecs("bytes", "imagecodecs_jpeg2k"),
    "vlen-utf8": codecs("vlen-utf8"),
    "vlen-bytes": codecs("vlen-bytes", "zstd"),
    "pickle in shards": said(in_shards),
    "text": said(lambda values: values.update(data_type="string", codecs=[{"name": "vlen-utf8"}])),
    "objects": said(lambda values: values.update(data_type="|O")),
    "dates": said(lambda values: values.update(data_type={"name": "numpy.datetime64"})),
    "negative shape": said(lambda values: values.update(shape=[-4, 2, 3])),
    "absurd shape": said(lambda values: values.update(shape=[2**60, 2, 3])),
    "shape of fractions": said(lambda values: values.update(shape=[4.0, 2, 3])),
    "no axes": said(lambda values: values.update(shape=[], chunk_grid={"name": "regular", "configuration": {"chunk_shape": []}})),
    "many axes": said(lambda values: values.update(shape=[1] * 40, chunk_grid={"name": "regular", "configuration": {"chunk_shape": [1] * 40}})),
    "chunks of nothing": said(lambda values: values["chunk_grid"]["configuration"].update(chunk_shape=[0, 2, 3])),
    "chunks of 90 GB": said(lambda values: values.update(shape=[4, 10**5, 10**5], chunk_grid={"name": "regular", "configuration": {"chunk_shape": [4, 10**5, 10**5]}})),
    "many chunks": said(lambda values: values.update(shape=[10**9, 2, 3])),
    "transformers": said(lambda values: values.update(storage_transformers=[{"name": "x"}])),
    "group in the group": said(lambda values: values.update(node_type="group")),
    "format 4": said(lambda values: values.update(zarr_format=4)),
    "array above": consolidated("../outside/moved"),
    "array at an absolute path": consolidated("/tmp/x"),
    "objects in the group's metadata": consolidated("counts", data_type="|O"),
    "pickle in the group's metadata": consolidated("counts", codecs=["bytes", "numcodecs.pickle"]),
    "linked array": linked("counts"),
    "linked chunk": linked("counts/c/0/0/0"),
    "linked metadata": linked("zarr.json"),
    "deep metadata": lambda store, outside: (store / "zarr.json").write_text("[" * 10**6),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_store_is_one_sentence_before_anything_is_decoded(store, tmp_path, name):
    outside = tmp_path / "outside"
    outside.mkdir()
    HOSTILE[name](store, outside)
    with pytest.raises(UserError) as refused, undamaged(store):
        open_store(store)
    assert str(store.name) in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not (outside / "ran").exists()


@pytest.mark.parametrize(
    "how",
    [
        {"compressors": ZstdCodec()},
        {"compressors": BloscCodec(cname="lz4", shuffle="bitshuffle")},
        {"compressors": GzipCodec()},
        {"compressors": None},
        {"shards": (4, 2, 3), "compressors": ZstdCodec(checksum=True)},
    ],
)
def test_harmless_codecs_are_read(tmp_path, how):
    group = zarr.open_group(tmp_path / "s.zarr", mode="w")
    group.create_array("counts", data=NUMBERS, chunks=(2, 2, 3), **how)
    np.testing.assert_array_equal(open_store(tmp_path / "s.zarr").arrays["counts"][:], NUMBERS)
    np.testing.assert_array_equal(open_array(tmp_path / "s.zarr" / "counts")[:], NUMBERS)


MUCH = bytes(2**24)


@pytest.mark.parametrize(
    ("codec", "bomb"),
    [
        (ZstdCodec(), Zstd(1).encode(MUCH)),
        (GzipCodec(), gzip.compress(MUCH)),
        (GzipCodec(), gzip.compress(MUCH[: 2**15]) * 40),
        (BloscCodec(), blosc.compress(MUCH, b"lz4", 5, 1)),
    ],
    ids=["zstd", "gzip", "many gzip", "blosc"],
)
def test_chunk_that_unpacks_to_more_than_it_states_is_refused(tmp_path, codec, bomb):
    zarr.create_array(tmp_path / "a.zarr", data=NUMBERS, compressors=codec)
    path = next(path for path in (tmp_path / "a.zarr" / "c").rglob("*") if path.is_file())
    path.write_bytes(bomb)
    with pytest.raises(ValueError, match="of 48 bytes unpacks to"):
        open_array(tmp_path / "a.zarr")[:]


def test_a_pickle_that_would_run_does_run_without_us(tmp_path):
    """The bait works: otherwise the tests would prove nothing."""
    group = zarr.open_group(tmp_path / "s.zarr", mode="w")
    group.create_array("counts", data=NUMBERS)
    as_format_2(tmp_path / "s.zarr", tmp_path / "ran")
    pickle.loads((tmp_path / "s.zarr" / "counts" / "0.0.0").read_bytes())
    assert (tmp_path / "ran").exists()
