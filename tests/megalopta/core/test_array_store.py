"""Arrays kept on disk for several processes at once."""

import os

import numpy as np

from megalopta.core.array_store import ArrayStore


def test_what_is_kept_comes_back(tmp_path):
    arrays = {"a/b": np.arange(5.0), "c": np.zeros((2, 0), np.uint8)}
    ArrayStore(tmp_path / "new", "key", 10**6).write(arrays)
    found = ArrayStore(tmp_path / "new", "key", 10**6).read()
    assert found.keys() == arrays.keys()
    for name, values in arrays.items():
        np.testing.assert_array_equal(found[name], values, strict=True)
    assert ArrayStore(tmp_path / "new", "key", 10**6).read(["d"]) is None
    assert ArrayStore(tmp_path / "new", "other", 10**6).read() is None


def test_damage_is_noticed(tmp_path):
    store = ArrayStore(tmp_path, "key", 10**6)
    store.write({"a": np.arange(1000)})
    path = tmp_path / "key.npz"
    whole = path.read_bytes()
    for damaged in (b"", whole[:500], whole[:2000] + b"!" + whole[2001:]):
        path.write_bytes(damaged)
        assert store.read() is None


def test_what_was_used_the_longest_ago_goes_first(tmp_path):
    values = {"a": np.zeros(1000)}
    for place, key in enumerate(("old", "used", "new")):
        ArrayStore(tmp_path, key, 10**9).write(values)
        os.utime(tmp_path / f"{key}.npz", (place, place))
    ArrayStore(tmp_path, "old", 10**9).read()  # now it is the last that was used
    ArrayStore(tmp_path, "newest", 3 * 9000).write(values)
    assert sorted(path.stem for path in tmp_path.iterdir()) == ["new", "newest", "old"]
