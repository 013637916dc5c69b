"""Files of strangers: only plain numbers in them are read, nothing runs, leads elsewhere or grows."""

import gzip
import json
import pickle

import h5py
import numpy as np
import pytest
import zarr
from numcodecs import Zstd, blosc
from pydantic import TypeAdapter
from zarr.codecs import BloscCodec, GzipCodec, ZstdCodec

from megalopta.config.model import load
from megalopta.config.recipe import load_plan
from megalopta.core.bounded import (
    check_count,
    check_decoded,
    named_path,
    numbers_in,
    open_store,
    opened_hdf5,
    undamaged,
)
from megalopta.core.errors import DamagedFileError, UserError
from megalopta.sensor import load_sensor

from ..harm import as_format_2


def damage(kind):
    """Raise what a reader may raise."""
    if kind == "values":
        TypeAdapter(list[int]).validate_python([1, "x", "y"])
    elif kind == "inner":
        with undamaged("a.zarr"):
            raise KeyError("x")
    raise {
        "part": DamagedFileError("material 'x' is empty; fill it"),
        "path": FileNotFoundError("a.zarr: no such file"),
        "user": UserError("choose one"),
    }[kind]


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("inner", r"^a\.zarr is missing or damaged \(lacks 'x'\); run b$"),
        ("values", r"^a\.zarr is missing or damaged \(1: Input [^\n]*\); run b$"),
        ("part", r"^a\.zarr: material 'x' is empty; fill it$"),
        ("path", r"^a\.zarr is missing or damaged \(no such file\); run b$"),
        ("user", "^choose one$"),
    ],
)
def test_damage_is_one_sentence_with_file_reason_and_the_outer_remedy(kind, message):
    with pytest.raises(UserError, match=message), undamaged("a.zarr", "run b"):
        damage(kind)


def test_content_beyond_the_budget_is_refused_with_its_size_and_the_setting(monkeypatch):
    check_decoded("a.png", (1000, 1000, 3), 8)
    with pytest.raises(UserError, match=r"^a\.png takes 24 GB .*MEGALOPTA_DECODED_GB"):
        check_decoded("a.png", (10**9, 3), 8)
    monkeypatch.setenv("MEGALOPTA_DECODED_GB", "25")
    check_decoded("a.png", (10**9, 3), 8)
    check_count("a.glb", "nodes", 10, 10)
    with pytest.raises(UserError, match=r"^a\.glb holds 11 nodes; at most 10 are read$"):
        check_count("a.glb", "nodes", 11, 10)


# Files that other files name

SECRET = "hunter2 is the password\n"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder of somebody else's files, with a secret outside of it, to which a link leads."""
    (tmp_path / "secret.csv").write_text(SECRET)
    folder = tmp_path / "stranger"
    folder.mkdir()
    for link in ("link.csv", "link.yaml"):
        (folder / link).symlink_to(tmp_path / "secret.csv")
    (folder / "loop.csv").symlink_to(folder / "loop.csv")
    (folder / "x.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "up").symlink_to(tmp_path)
    monkeypatch.chdir(tmp_path)
    return folder


ELSEWHERE = (
    "../secret.csv", "{outside}/secret.csv", "/etc/passwd", "link.csv", "loop.csv", "up/secret.csv",
    "up/../secret.csv", "~/secret.csv/../../../secret.csv", "file:///etc/passwd", "C:secret.csv", "a\0b",
)  # fmt: skip


@pytest.mark.parametrize("named", ELSEWHERE)
def test_a_file_names_nothing_outside_of_its_folder_and_users_name_any(place, named):
    with pytest.raises(ValueError, match=r"is not in the folder of the file that names it"):
        named_path(named.format(outside=place.parent), place)
    assert named_path(named, None).name
    for inside in ("curve.csv", "sub/curve.csv", "sub/../curve.csv"):
        assert named_path(inside, place) == place / inside


SENSORS = {
    "efficiency": "efficiency: {{path: {0}}}",
    "lens": "lens: {{transmission_curve: {{path: {0}}}}}",
    "map": "measured: {{dark_counts: {0}}}",
    "map without hash": "measured: {{dark_counts: {{path: {0}, sha256: null}}}}",
    "kernel": "crosstalk: {{mean_fired_neighbors: 0.1, kernel: {{path: {0}}}}}",
}
SCENES = {
    "sensor": "sensors: [{0}]",
    "preset": "sensors: [{{preset: {0}, exposure_s: 1}}]",
    "map of a sensor": "sensors: [{{preset: spadcam, measured: {{dark_counts: {0}}}}}]",
    "recorded path": "trajectory: {{kind: recorded, csv: {0}}}",
    "panorama": "light: {{panorama: {0}}}",
    "scene's panorama": "scene: {{kind: panorama, file: {0}}}",
    "mesh": "scene: {{kind: meshes, files: [{0}]}}",
    "reflectance": "scene: {{kind: meshes, files: [x.obj], materials: {{paint: {0}}}}}",
    "pictures": "scene: {{kind: pictures, file: {0}}}",
}


def read_sensor(path, text):
    path.write_text(f"preset: spadcam\n{text}\n")
    load_sensor(path)


def read_scene(path, text):
    path.write_text(text)
    load(str(path), {"light_levels": "[starlight]"})  # which does not let the file name more


@pytest.mark.parametrize("named", ["../secret.csv", "link.csv"])
@pytest.mark.parametrize(
    ("read", "text"),
    [
        *((read_sensor, text) for text in SENSORS.values()),
        *((read_scene, text) for text in SCENES.values()),
    ],
)
def test_a_sensor_and_a_scene_lead_nowhere_and_nothing_is_quoted(place, read, text, named):
    named = (
        named.replace(".csv", ".yaml")
        if "sensors: [{0}]" in text or "preset: {0}" in text
        else named
    )
    with pytest.raises((ValueError, UserError), match="is not in the folder of the file|link leads") as refused:  # fmt: skip
        read(place / "own.yaml", text.format(named))
    assert "hunter2" not in str(refused.value)


def test_a_plan_leads_nowhere(place):
    (place / "plan.yaml").write_text("trajectories: [{kind: recorded, csv: ../secret.csv}]\n")
    with pytest.raises(UserError, match="is not in the folder of the file"):
        load_plan(place / "plan.yaml", {"sequences": "1"})


def test_the_command_line_names_any_file_beside_those_of_the_file(place):
    (place.parent / "curve.csv").write_text("400,0.1\n1000,0.2\n")
    (place / "own.csv").write_text("400,0.3\n1000,0.4\n")
    (place / "own.yaml").write_text(
        "sensors: [spadcam, {preset: ideal, efficiency: {path: own.csv}}]\n"
    )
    given = {"sensors.0.efficiency": "{path: curve.csv}"}
    sensors = load(str(place / "own.yaml"), given).sensors
    assert [sensor.efficiency.values for sensor in sensors] == [(0.1, 0.2), (0.3, 0.4)]


# HDF5

HDF5 = {
    "external link": lambda file: file.__setitem__("a/b", h5py.ExternalLink("other.h5", "a/b")),
    "external link of the group": lambda file: file.__setitem__("a", h5py.ExternalLink("other.h5", "a")),
    "soft link": lambda file: (file.__setitem__("c", [1.0]), file.__setitem__("a/b", h5py.SoftLink("/c"))),
    "external storage": lambda file: file.create_dataset("a/b", (4,), "f8", external=[("raw", 0, 32)]),
    "object references": lambda file: file.create_dataset("a/b", (4,), h5py.ref_dtype),
    "text": lambda file: file.create_dataset("a/b", data=["x", "y"]),
    "records": lambda file: file.create_dataset("a/b", data=np.zeros(4, "f8,i4")),
    "nothing": lambda file: file.create_dataset("a/b", data=h5py.Empty("f8")),
    "a group": lambda file: file.create_group("a/b"),
    "two axes": lambda file: file.create_dataset("a/b", (2, 2), "f8"),
    "scale-offset": lambda file: file.create_dataset("a/b", (4,), "i4", chunks=(4,), scaleoffset=0),
}  # fmt: skip


def virtual(file):
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "a/b", (4,))
    file.create_virtual_dataset("a/b", layout)


@pytest.mark.parametrize("make", [*HDF5.values(), virtual], ids=[*HDF5, "virtual"])
def test_hdf5_that_leads_elsewhere_or_is_no_array_is_refused(tmp_path, make):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["a/b"] = np.arange(4.0)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        make(file)
    with (
        opened_hdf5(tmp_path / "a.h5") as file,
        pytest.raises(ValueError, match="^a/b (is|needs) "),
    ):
        numbers_in(file, "a/b", "f", 1)


@pytest.mark.parametrize("how", [{"compression": "gzip"}, {"compression": "lzf"}, {}])
def test_plain_numbers_with_the_filters_of_h5py_are_read(tmp_path, how):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a/b", data=np.arange(4.0), chunks=(2,), shuffle=True, **how)
    with opened_hdf5(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(numbers_in(file, "a/b", "f", 1), np.arange(4.0))


@pytest.mark.parametrize(("shape", "chunks"), [((10**9,), (1000,)), ((10,), (2**29,))])
def test_size_of_hdf5_is_checked_before_it_is_decoded(tmp_path, shape, chunks):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a/b", shape, "f8", chunks=chunks, maxshape=(None,), compression="gzip")
    with opened_hdf5(tmp_path / "a.h5") as file, pytest.raises(UserError, match="GB of memory"):
        numbers_in(file, "a/b", "f", 1)


# Zarr

NUMBERS = np.arange(24, dtype=np.uint16).reshape(4, 2, 3)


@pytest.fixture
def store(tmp_path):
    group = zarr.open_group(tmp_path / "s.zarr", mode="w", attributes={"unit": "counts"})
    group.create_array("counts", data=NUMBERS, chunks=(2, 2, 3))
    return tmp_path / "s.zarr"


def said(**fields):
    """Other metadata of the array."""

    def put(store, outside):
        path = store / "counts" / "zarr.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | fields))

    return put


def chunks_of(shape, chunks):
    grid = {"name": "regular", "configuration": {"chunk_shape": chunks}}
    return said(shape=shape, chunk_grid=grid)


def consolidated(name, **fields):
    """Metadata of the group that differ from those of the array."""

    def put(store, outside):
        path = store / "zarr.json"
        array = json.loads((store / "counts" / "zarr.json").read_text()) | fields
        inside = {"kind": "inline", "must_understand": False, "metadata": {name: array}}
        values = json.loads(path.read_text()) | {"consolidated_metadata": inside}
        path.write_text(json.dumps(values))

    return put


def linked(name):
    def put(store, outside):
        (store / name).rename(outside / "moved")
        (store / name).symlink_to(outside / "moved")

    return put


SHARDS = {"chunk_shape": [1, 2, 3], "codecs": [{"name": "numcodecs.pickle"}], "index_codecs": []}
ZARR = {
    "format 2": lambda store, outside: as_format_2(store, outside / "ran"),
    "format 2 beside": lambda store, outside: (store / "counts" / ".zarray").write_text("{}"),
    "pickle": said(codecs=[{"name": "bytes"}, {"name": "numcodecs.pickle"}]),
    "codec of a package": said(codecs=[{"name": "bytes"}, {"name": "imagecodecs_jpeg2k"}]),
    "vlen-bytes": said(codecs=[{"name": "vlen-bytes"}, {"name": "zstd"}]),
    "pickle in shards": said(codecs=[{"name": "sharding_indexed", "configuration": SHARDS}]),
    "text": said(data_type="string"),
    "objects": said(data_type="|O"),
    "dates": said(data_type={"name": "numpy.datetime64"}),
    "negative shape": said(shape=[-4, 2, 3]),
    "absurd shape": said(shape=[2**60, 2, 3]),
    "shape of fractions": said(shape=[4.0, 2, 3]),
    "no axes": chunks_of([], []),
    "many axes": chunks_of([1] * 40, [1] * 40),
    "chunks of nothing": chunks_of([4, 2, 3], [0, 2, 3]),
    "chunks of 90 GB": chunks_of([4, 10**5, 10**5], [4, 10**5, 10**5]),
    "many chunks": said(shape=[10**9, 2, 3]),
    "transformers": said(storage_transformers=[{"name": "x"}]),
    "group in the group": said(node_type="group"),
    "format 4": said(zarr_format=4),
    "array above": consolidated("../outside/moved"),
    "array at an absolute path": consolidated("/tmp/x"),
    "pickle in the group's metadata": consolidated("counts", codecs=["bytes", "numcodecs.pickle"]),
    "linked array": linked("counts"),
    "linked chunk": linked("counts/c/0/0/0"),
    "linked metadata": linked("zarr.json"),
    "deep metadata": lambda store, outside: (store / "zarr.json").write_text("[" * 10**6),
}


@pytest.mark.parametrize("name", ZARR)
def test_hostile_store_is_one_sentence_before_anything_is_decoded(store, tmp_path, name):
    outside = tmp_path / "outside"
    outside.mkdir()
    ZARR[name](store, outside)
    with pytest.raises(UserError) as refused, undamaged(store):
        open_store(store)
    assert str(store.name) in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not (outside / "ran").exists()


def test_a_pickle_that_would_run_does_run_without_us(store, tmp_path):
    """The bait works: otherwise the tests would prove nothing."""
    as_format_2(store, tmp_path / "ran")
    pickle.loads((store / "counts" / "0.0.0").read_bytes())
    assert (tmp_path / "ran").exists()


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
    group = zarr.open_group(tmp_path / "a.zarr", mode="w")
    group.create_array("counts", data=NUMBERS, compressors=codec)
    path = next(path for path in (tmp_path / "a.zarr/counts/c").rglob("*") if path.is_file())
    path.write_bytes(bomb)
    with pytest.raises(ValueError, match="of 48 bytes unpacks to"):
        open_store(tmp_path / "a.zarr").arrays["counts"][:]
