import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial import cKDTree
from scipy.stats import binomtest

from megalopta.scenes.forest.description import Forest, build_forest, foreseen
from megalopta.scenes.forest.flora import PRESETS, TREES
from megalopta.scenes.forest.planting import REGULARITY, THICKET

FOREST = Forest(seed=11)
PATH = np.stack([np.linspace(-1, 4, 11), np.linspace(0, 1, 11)], axis=-1)
EYE_M = 1.5
TINY = Forest(
    trees=8, density_per_ha=80, mix={"birch": 1, "spruce": 1}, undergrowth=0.02, detail=0.05
)


@pytest.fixture(scope="module")
def scene():
    return build_forest(FOREST, PATH)


@pytest.fixture(scope="module")
def trunks(scene):
    """Position of every tree and its distance from the path, nearest first."""
    points = [p.to_world[:2, 3] for p in scene.placements if p.kind in TREES]
    distance, _ = cKDTree(dense(PATH)).query(points)
    order = np.argsort(distance)
    return np.array(points)[order], distance[order]


def dense(path):
    share = np.linspace(0, 1, 2000)
    return np.stack([np.interp(share, np.linspace(0, 1, len(path)), c) for c in path.T], axis=-1)


def digest(scene):
    """One hash of all that is in a scene, in its order."""
    content = hashlib.sha256()
    for name, asset in scene.assets.items():
        for part, mesh in asset.parts.items():
            content.update(f"{name} {part}".encode())
            for array in (mesh.vertices, mesh.faces, mesh.visual.uv, mesh.vertex_normals):
                content.update(np.ascontiguousarray(array).tobytes())
    for placement in scene.placements:
        content.update(f"{placement.asset} {placement.kind}".encode())
        content.update(placement.to_world.tobytes())
    for name, material in scene.materials.items():
        content.update(f"{name} {material.reflectance} {material.texture.reflectance}".encode())
        content.update(material.texture.weight.tobytes())
    return content.hexdigest()


@pytest.mark.slow
def test_same_seed_gives_the_same_bytes_in_another_process():
    code = (
        "import sys; sys.path.insert(0, 'tests/scenes/forest'); import test_description as t;"
        "print(t.digest(t.build_forest(t.TINY, t.PATH)))"
    )
    environment = os.environ | {"PYTHONHASHSEED": "4711", "OMP_NUM_THREADS": "1"}
    other = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert other.stdout.strip() == digest(build_forest(TINY, PATH))


def test_trees_keep_their_distance_from_each_other_and_from_the_path(trunks):
    points, distance = trunks
    nearest = cKDTree(points).query(points, k=2)[0][:, 1]
    assert nearest.min() >= REGULARITY * 100 / np.sqrt(FOREST.density_per_ha)
    # the path is replaced by points half a meter apart: at most 3 cm off at 1.2 m
    assert distance.min() >= FOREST.clearance_m - 0.03


def test_the_stand_has_its_density(trunks):
    _, distance = trunks
    edge = distance[FOREST.trees - 1]
    length = np.linalg.norm(PATH[-1] - PATH[0])
    area = sum(
        s * (np.pi * r**2 + 2 * r * length) for r, s in ((edge, 1), (FOREST.clearance_m, -1))
    )
    expected = area * FOREST.density_per_ha / 1e4
    # Poisson-disk counts vary less than Poisson ones: 5 standard deviations, false alarms below 6e-7
    assert abs(FOREST.trees - expected) < 5 * np.sqrt(expected)


def test_the_mix_of_species_is_the_one_asked_for(scene):
    kinds = [placement.kind for placement in scene.placements if placement.kind in TREES]
    for name, share in FOREST.mix.items():
        assert binomtest(kinds.count(name), len(kinds), share).pvalue > 1e-7


def test_nothing_grows_into_the_camera(scene):
    eye = cKDTree(np.column_stack([dense(PATH), np.full(2000, EYE_M)]))
    for placement in scene.placements[1:]:
        if np.hypot(*(placement.to_world[:2, 3] - PATH.mean(axis=0))) < 9:
            matrix = placement.to_world
            for mesh in scene.assets[placement.asset].parts.values():
                vertices = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
                assert eye.query(vertices, distance_upper_bound=0.4)[0].min() == np.inf


@pytest.mark.parametrize("name", PRESETS)
def test_presets_set_what_is_not_given(name):
    changed = {"preset": name, "trees": 333, "mix": {"oak": 1}}
    forest = Forest.model_validate(changed)
    assert forest.model_dump() == {**Forest().model_dump(), **PRESETS[name], **changed}
    assert Forest.model_validate_json(forest.model_dump_json()) == forest


@pytest.mark.parametrize(
    "forest", [FOREST, pytest.param(Forest(preset="open"), marks=pytest.mark.slow)]
)
def test_the_size_of_a_forest_is_foreseen(scene, forest):
    scene = scene if forest is FOREST else build_forest(forest, PATH)
    plants, triangles = foreseen(forest, np.linalg.norm(PATH[-1] - PATH[0]))
    # a guard against absurd settings: right to a factor of two
    assert 0.5 < scene.triangle_count / triangles < 2
    assert 0.5 < len(scene.placements) / plants < 2


def test_without_undergrowth_around_one_place_only_one_species_and_the_belt_are_left():
    forest = TINY.model_copy(update={"mix": {"birch": 2.0}, "undergrowth": 0.0})
    bare = build_forest(forest, [[3.0, -2.0]])
    assert {placement.kind for placement in bare.placements} == {"ground", "birch", *THICKET}


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("mix", {"beech": 0}, "sum to 0"),
        ("mix", {"larch": 1}, r"unknown kind \['larch'\]; choose from \['aspen'"),
        ("undergrowth_per_m2", {"larch": 1}, r"unknown kind \['larch'\]; choose from \['bilberry'"),
        ("undergrowth_per_m2", {"fern": 1e6}, r"make about 1\.\de\+09 plants of .* lower one"),
    ],
)
def test_impossible_forests_are_refused(field, value, message):
    with pytest.raises(ValidationError, match=message):
        Forest.model_validate({field: value})
