"""Kept plants are the grown ones."""

import numpy as np
import pytest

from megalopta.scenes.forest import specimens as nursery
from megalopta.scenes.forest.flora import PLANTS
from megalopta.scenes.forest.plants import LODS


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    nursery.texture.cache_clear()
    yield tmp_path / "megalopta" / "plants"
    nursery.texture.cache_clear()


def equal(first, second):
    assert len(first) == len(second)
    for one, other in zip(first, second, strict=True):
        assert list(one) == list(other)
        for organ, surface in one.items():
            for field in ("vertices", "faces", "uv", "normals"):
                a, b = getattr(surface, field), getattr(other[organ], field)
                assert (a is None) == (b is None)
                if a is not None:
                    np.testing.assert_array_equal(a, b, strict=True)


@pytest.mark.parametrize("kind", ["hazel", "fern", "rock"])
def test_a_kept_plant_is_the_grown_one(kind, cache, monkeypatch):
    plant, levels = PLANTS[kind], LODS[:2]
    grown = nursery.grown(3, plant, 1, levels)
    (path,) = cache.iterdir()
    with monkeypatch.context() as patched:
        patched.setattr(type(plant), "grow", lambda *_: pytest.fail("grown anew"))
        equal(nursery.grown(3, plant, 1, levels), grown)
    path.write_bytes(path.read_bytes()[:100])  # damaged: grown anew
    equal(nursery.grown(3, plant, 1, levels), grown)


def test_plants_that_differ_are_kept_apart(cache):
    fern = PLANTS["fern"]
    for case in ((3, fern, 1, LODS[:2]), (4, fern, 1, LODS[:2]), (3, fern, 2, LODS[:2])):
        nursery.grown(*case)
    nursery.grown(3, fern, 1, LODS[1:2])
    nursery.grown(3, PLANTS["rock"], 1, LODS[:2])
    assert len(list(cache.iterdir())) == 5


def test_a_kept_texture_is_the_painted_one(cache):
    painted = nursery.texture(3, "needles")
    nursery.texture.cache_clear()
    np.testing.assert_array_equal(nursery.texture(3, "needles"), painted, strict=True)
    assert len(list(cache.iterdir())) == 1
    assert not painted.flags.writeable
