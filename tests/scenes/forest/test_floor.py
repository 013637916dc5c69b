"""A trodden path, moss, bumps and bark with relief in a forest."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from megalopta.assets_gen.scatter import distance_to
from megalopta.assets_gen.triangulation import Triangulation
from megalopta.scenes.forest.description import Forest, build_forest
from megalopta.scenes.forest.floor import MOSS_RING_M, kept_floor, make_floor, make_land, trail_of
from megalopta.scenes.forest.flora import LAYERS, TREES
from megalopta.scenes.forest.planting import dense_path

PATH = np.stack([np.linspace(-1, 2, 7), np.linspace(0, 1, 7)], axis=-1)
WAY = cKDTree(dense_path(PATH))
ROUGH = Forest(
    seed=5,
    trees=60,
    density_per_ha=900,
    mix={"oak": 1, "spruce": 1},
    undergrowth_per_m2={"litter": 1.0, "fern": 0.3, "herb": 0.5, "young beech": 0.05, "log": 0.02},
    detail=0.2,
    floor_relief_m=0.04,
    moss_share=0.35,
    path_width_m=1.0,
    bark_relief=1.0,
)


@pytest.fixture(scope="module")
def scene():
    return build_forest(ROUGH, PATH)


@pytest.fixture(scope="module")
def ground(scene):
    """Corners, triangles and cover of each triangle of the ground, all parts as one."""
    corners, faces, covers, first = [], [], [], 0
    for cover, mesh in scene.assets["ground"].parts.items():
        corners.append(mesh.vertices)
        faces.append(mesh.faces + first)
        covers += [cover] * len(mesh.faces)
        first += len(mesh.vertices)
    return np.concatenate(corners), np.concatenate(faces), np.array(covers)


def plan_areas(corners, faces):
    a, b, c = corners[faces][..., :2].swapaxes(0, 1)
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    return np.abs(ux * vy - uy * vx) / 2


def test_moss_covers_the_share_asked_for(ground):
    corners, faces, covers = ground
    areas = plan_areas(corners, faces)
    away = distance_to(WAY, corners[faces][..., :2].mean(axis=1))
    near = (away < MOSS_RING_M) & (covers != "trodden ground")
    share = areas[near & (covers == "moss patch ground")].sum() / areas[near].sum()
    # To some triangles: the ring is cut by the distance of their middles or of their corners.
    assert share == pytest.approx(ROUGH.moss_share, abs=0.01)


def test_the_path_is_as_wide_as_asked_for_and_lies_under_the_camera(ground):
    corners, faces, covers = ground
    trodden = covers == "trodden ground"
    middles = corners[faces][..., :2].mean(axis=1)
    along = (middles - PATH[0]) @ (PATH[-1] - PATH[0]) / np.sum((PATH[-1] - PATH[0]) ** 2)
    beside = (along > 0) & (along < 1) & (distance_to(WAY, middles) < 2)
    area = plan_areas(corners, faces[trodden & beside]).sum()
    # One trail of 3 m: margins of 0.13 m rms in waves up to 4 m on both sides.
    width = area / np.linalg.norm(PATH[-1] - PATH[0])
    assert width == pytest.approx(ROUGH.path_width_m, abs=0.35)
    nearest = cKDTree(middles).query(PATH)[1]
    assert trodden[nearest].all()


def test_nothing_but_litter_is_on_the_path(scene):
    trail = trail_of(ROUGH, dense_path(PATH), np.array([1.0, 0.0]))
    growing = [p for p in scene.placements[1:] if p.kind != "litter"]
    inside = trail.inside(np.array([p.to_world[:2, 3] for p in growing]))
    assert inside.max() < 0
    assert {p.kind for p in growing} >= {"oak", "spruce", "fern", "herb", "young beech"}


def test_plants_stand_on_the_mesh(scene, ground):
    standing = [
        p.to_world[:3, 3] for p in scene.placements[1:] if p.kind in {*TREES, *LAYERS} - {"litter"}
    ]
    corners, faces, _ = ground
    heights = Triangulation(corners[:, :2], faces).interpolated(
        corners[:, 2], np.array(standing)[:, :2]
    )
    np.testing.assert_allclose(np.array(standing)[:, 2], heights, atol=1e-9)


@pytest.mark.slow
def test_bumps_have_the_height_asked_for():
    land = make_land(2, WAY, 0.6, 20.0)
    flat, rough = (
        make_floor(
            Forest(seed=2, floor_relief_m=relief, detail=0.6), land, None, np.zeros((1, 2)), 20.0
        )
        for relief in (0.0, 0.05)
    )
    np.testing.assert_array_equal(flat.heights, land.height(flat.mesh.points))
    bumps = (rough.heights - flat.heights)[distance_to(WAY, flat.mesh.points) < 1.5]
    # Some 17 m² hold about 30 of the longest waves, half of the variance: 9 % standard error.
    assert bumps.std() == pytest.approx(0.05, rel=0.45)
    assert abs(bumps.mean()) < 0.02


def test_the_ground_is_one_object_whose_parts_meet(scene, ground):
    assert [p.kind for p in scene.placements].count("ground") == 1
    corners, faces, covers = ground
    assert set(covers) == {"litter ground", "moss patch ground", "trodden ground"}
    _, welded = np.unique(corners, axis=0, return_inverse=True)
    joined = welded.reshape(-1)[faces]
    edges = np.sort(joined[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, times = np.unique(edges, axis=0, return_counts=True)
    assert times.max() == 2  # no crack between covers, no triangle twice
    normals = np.concatenate(
        [mesh.vertex_normals for mesh in scene.assets["ground"].parts.values()]
    )
    order = np.argsort(welded.reshape(-1), kind="stable")
    same = np.diff(welded.reshape(-1)[order]) == 0
    np.testing.assert_allclose(normals[order][1:][same], normals[order][:-1][same], atol=1e-12)
    assert normals[:, 2].min() > 0


def test_a_kept_floor_is_the_one_that_was_made(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    trail, trees = trail_of(ROUGH, WAY.data, np.array([1.0, 0])), np.zeros((1, 2))
    given = make_land(ROUGH.seed, WAY, ROUGH.relief_m, 12.0), trail, trees, 12.0
    made = kept_floor(ROUGH, *given)
    with monkeypatch.context() as patched:
        patched.setattr(
            "megalopta.scenes.forest.floor.make_floor", lambda *_: pytest.fail("made anew")
        )
        again = kept_floor(ROUGH.model_copy(update={"undergrowth": 0.5}), *given)
    assert list(made.covers) == list(again.covers)
    before, after = (
        [f.mesh.points, f.mesh.faces, f.heights, f.uv, f.leaves, *f.covers.values()]
        for f in (made, again)
    )
    for first, second in zip(before, after, strict=True):
        np.testing.assert_array_equal(first, second, strict=True)
