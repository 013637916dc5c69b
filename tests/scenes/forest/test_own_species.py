"""Species of the user's own, from a YAML file and in the configuration."""

import json

import numpy as np
import pytest

from megalopta.config.model import Configuration, load, parse
from megalopta.core.errors import UserError
from megalopta.scenes.forest.description import build_forest
from megalopta.scenes.forest.flora import ENTRIES, TREES
from megalopta.scenes.forest.own_species import OwnSpecies, flora_of, size_of
from megalopta.scenes.forest.specimens import grow_specimens

ROWAN = """
rowan:
  like: birch
  shape: {height_m: 8, crown: {radius_m: 1.4}}
  leaf: [young leaf dark, young leaf light * 0.9]
juniper:
  like: young spruce
  shape: {height_m: 2.0}
  layer: {per_m2: 0.05}
"""
STAND = {"trees": 60, "density_per_ha": 900, "undergrowth": 0.2, "detail": 0.01, "relief_m": 0.0}


@pytest.fixture
def configured(tmp_path, monkeypatch):
    (tmp_path / "woods").mkdir()
    (tmp_path / "woods/flora.yaml").write_text(ROWAN)
    (tmp_path / "woods/mine.yaml").write_text(
        "scene: {kind: forest, species: flora.yaml, mix: {rowan: 1, beech: 1},"
        " undergrowth_per_m2: {juniper: 0.1, fern: 0.5}}"
    )
    monkeypatch.chdir(tmp_path)
    return load("woods/mine.yaml")


def test_a_file_is_next_to_its_configuration_and_becomes_part_of_it(configured):
    species = configured.scene.species
    assert species["rowan"].shape.height_m == 8
    assert species["rowan"].shape.crown.base == TREES["birch"].shape.crown.base
    assert species["juniper"].layer.per_m2 == 0.05
    again = Configuration.model_validate(json.loads(configured.model_dump_json()))
    assert again == configured
    changed = parse(
        "name: a", "test", {"scene.species": "woods/flora.yaml", "scene.mix": "{rowan: 1}"}
    )
    assert changed.scene.species["rowan"] == species["rowan"]


def test_own_trees_and_bushes_grow_in_the_forest(configured):
    forest = configured.scene.model_copy(update=STAND)
    scene = build_forest(forest, np.array([[0.0, 0], [2, 0]]))
    kinds = [placement.kind for placement in scene.placements]
    assert {"rowan", "beech", "juniper", "fern"} <= {*kinds}
    # Half of all trees, with those of the belt; five deviations of a fair draw.
    trees = [kind for kind in kinds if kind in ("rowan", "beech")]
    assert abs(trees.count("rowan") / len(trees) - 0.5) < 5 * 0.5 / np.sqrt(len(trees))
    assert {"rowan leaf", "rowan bark", "juniper leaf"} <= scene.materials.keys()
    tallest = max(
        mesh.vertices[:, 2].max() * np.cbrt(np.linalg.det(placement.to_world[:3, :3]))
        for placement in scene.placements
        if placement.kind == "rowan"
        for mesh in scene.assets[placement.asset].parts.values()
    )
    # The tallest class has 1.25 of the height, and trees of a class differ by up to a fifth.
    assert 8 * 1.25 * 0.8 < tallest < 8 * 1.25 * 1.2 * 1.1


def test_a_changed_species_of_the_same_name_is_grown_anew():
    def leaves(height):
        shape = {"height_m": height}
        own = {"rowan": OwnSpecies.model_validate({"like": "birch", "shape": shape})}
        flora = flora_of(own)
        (organs,) = grow_specimens(1, ["rowan 2 far"], flora=flora).values()
        return organs["bark"].vertices[:, 2].max()

    assert leaves(6) < 0.7 * leaves(12)


def test_the_program_s_own_species_are_within_all_bounds():
    for entry in ENTRIES.values():
        branches, leaves = size_of(OwnSpecies.model_validate(entry).shape)
        assert branches < 2e3
        assert leaves < 2e5


@pytest.mark.parametrize(
    ("species", "message"),
    [
        ({"beech": {"like": "birch"}}, "beech: this name is taken"),
        ({"a/b": {"like": "birch"}}, "'a/b' cannot name a species"),
        ({"rowan": {"like": "oak tree"}}, "like: no species 'oak tree'"),
        ({"rowan": {"like": "birch", "leaf": ["red", "leaf dark"]}}, "'red' is unknown"),
        ({"rowan": {"like": "birch", "leaf": ["leaf dark * 3", "leaf dark"]}}, "at most 1"),
        ({"rowan": {"like": "birch", "shape": {"height_m": 900}}}, "at most 100 m high"),
        (
            {"rowan": {"like": "birch", "shape": {"growth": {"shoots": 10**9}}}},
            r"about 1e\+09 branches",
        ),
        ({"rowan": {"like": "birch", "shape": {"crown": {"profile": [1]}}}}, "profile has 1 radii"),
        ({"rowan": {"like": "birch", "shape": {"hight_m": 3}}}, "hight_m"),
    ],
)
def test_species_that_cannot_grow_are_refused(species, message):
    with pytest.raises(UserError, match=message):
        parse(json.dumps({"scene": {"kind": "forest", "species": species}}), "test")
