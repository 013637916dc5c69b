import numpy as np
import pytest

from megalopta.render.baking import cells as cells_module
from megalopta.render.baking.cells import CellFinder, Cells
from megalopta.render.baking.visibility import VIEWS, survey, views
from megalopta.render.loading.meshes import MergedMesh
from megalopta.render.loading.scene import load_scene
from megalopta.render.mitsuba_loader import activate
from megalopta.render.variant import choose_variant
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectra.spectrum import flat
from megalopta.scenes.trajectories.steady import Trajectory

vectorized = pytest.mark.skipif(
    choose_variant().name.startswith("scalar"), reason="cells are found by vectorized rays"
)
CAMERA = PerspectiveCamera(width=64, height=64, fov_deg=60)
THING = Scene({"thing": Material(flat(0.5))}, {}, ())
PATH = np.array([[0.0, 0.0, 1.0], [3.0, 0.0, 1.0]])


@pytest.fixture(autouse=True)
def coarse_pieces(monkeypatch):
    """Few cells, so that some faces here are one."""
    monkeypatch.setattr(cells_module, "PIECE_PX", 4.0)


def triangle_mesh(corners, normals=None):
    count = len(corners)
    return MergedMesh(
        "thing",
        np.reshape(corners, (-1, 3)).astype(np.float32),
        np.arange(3 * count, dtype=np.uint32).reshape(count, 3),
        normals,
        None,
        np.ones(count, np.uint32),
    )


def random_triangles(count=200):
    rng = np.random.default_rng(1)
    center = rng.uniform(-3, 3, (count, 1, 3))
    return center + rng.normal(size=(count, 3, 3)) * rng.uniform(0.01, 1, (count, 1, 3))


def test_no_piece_is_longer_than_its_pixels_at_the_nearest_camera():
    corners = random_triangles()
    cells = Cells.of([triangle_mesh(corners)], CAMERA, PATH)
    faces = np.arange(len(corners))
    start, middle, end = (corners[faces, (cells.origin + k) % 3] for k in range(3))
    edges = [np.linalg.norm(middle - start, axis=1), np.linalg.norm(end - start, axis=1)]
    # A bound from geometry alone: no point of a triangle is nearer than its nearest corner less
    # the longest edge.
    reach = np.max(edges, axis=0) + np.linalg.norm(end - middle, axis=1)
    nearest = np.linalg.norm(corners[:, :, None] - PATH, axis=-1).min(axis=(1, 2)) + reach
    pixel = np.radians(60) / 64
    assert (np.array(edges) / cells.pieces <= 1.3 * cells_module.PIECE_PX * pixel * nearest).all()
    assert cells.pieces.max() > 5 > cells.pieces.min() == 1


def test_normals_that_turn_cut_a_face_further():
    corners = [[[2, 0, 0], [2, 0.3, 0], [2, 0, 0.3]]]
    even = np.tile([1, 0, 0], (3, 1)).astype(np.float32)
    bent = even.copy()
    bent[1] = [0, 1, 0]
    flat_cells, bent_cells = (
        Cells.of([triangle_mesh(corners, normals)], CAMERA, PATH) for normals in (even, bent)
    )
    # A right angle at 0.25 rad a piece; the other edge does not turn.
    assert flat_cells.pieces.max() < 7
    assert sorted(bent_cells.pieces[:, 0]) == [flat_cells.pieces.min(), 7]


def test_too_many_cells_are_refused_with_a_remedy(monkeypatch):
    monkeypatch.setattr(cells_module, "MOST_CELLS", 10)
    with pytest.raises(ValueError, match="and 10 fit; use 'path'"):
        Cells.of([triangle_mesh(random_triangles())], CAMERA, PATH)


@vectorized
def test_points_drawn_in_a_cell_lie_in_it_and_cover_its_face_evenly():
    activate(choose_variant())
    import drjit as dr
    import mitsuba as mi

    meshes = [triangle_mesh(random_triangles(100)), triangle_mesh(random_triangles(30))]
    cells = Cells.of(meshes, CAMERA, PATH)
    rng = np.random.default_rng(2)
    wanted = rng.integers(0, cells.count, 20_000).astype(np.uint32)
    patches = cells.patches(wanted)
    a, b = (mi.Float(values) for values in rng.random((2, len(wanted))))
    hit = dr.zeros(mi.PreliminaryIntersection3f, len(wanted))
    hit.prim_uv = patches.barycentric(mi.UInt, a, b)
    hit.prim_index, mesh = mi.UInt(patches.triangle), mi.UInt(patches.mesh)
    finder = CellFinder(cells, load_scene(THING, meshes))
    cell, places = finder.find(hit, mesh, mi.UInt(patches.side) == 0, True)
    found = np.array(cell)
    # Points on a cell's rim may fall to its neighbor, and grid cells that lie outside the triangle
    # (just under half of them) hold no points.
    pieces, (i, j) = patches.pieces, patches.indices
    holds = i / pieces[0] + j / pieces[1] < 1 - 1e-6
    is_found = holds & (found == wanted)
    assert is_found.sum() > 0.97 * holds.sum()
    # of what lies on the longest edge, half was turned about the middle of its cell
    i, j = patches.indices[:, is_found] + 1
    whole = np.flatnonzero(is_found)[i / pieces[0][is_found] + j / pieces[1][is_found] < 1]
    for place, wanted_at in zip(places, (a, b), strict=True):
        np.testing.assert_allclose(np.array(place)[whole], np.array(wanted_at)[whole], atol=2e-3)
    for name in ("mesh", "triangle", "side"):
        np.testing.assert_array_equal(
            getattr(cells.patches(found), name), getattr(patches, name), name
        )


@vectorized
def test_rays_find_the_cell_that_holds_the_point_they_hit():
    activate(choose_variant())
    import mitsuba as mi

    meshes = [triangle_mesh(random_triangles())]
    cells = Cells.of(meshes, CAMERA, PATH)
    loaded = load_scene(THING, meshes)
    target = random_triangles().mean(axis=1)
    origin = np.array([0.0, 0.0, 10.0])
    rays = mi.Ray3f(mi.Point3f(origin.tolist()), mi.Vector3f((target - origin).T))
    hit = loaded.ray_intersect_preliminary(rays)
    point = hit.compute_surface_interaction(rays, mi.RayFlags.All)
    finder = CellFinder(cells, loaded)
    found = np.array(finder.find(hit, mi.UInt(0), point.wi.z > 0, True)[0])
    patches = cells.patches(found)
    triangle, where = np.array(hit.prim_index), np.array(point.p).T
    np.testing.assert_array_equal(patches.triangle, triangle)
    corners = meshes[0].vertices[meshes[0].faces].astype(np.float64)[triangle]
    rows = np.arange(len(triangle))
    start, *ends = (corners[rows, (patches.origin + k) % 3] for k in range(3))
    edges = np.stack([end - start for end in ends], axis=-1)
    uv = np.stack(
        [np.linalg.lstsq(e, p, rcond=None)[0] for e, p in zip(edges, where - start, strict=True)]
    )
    inside = uv * patches.pieces.T - patches.indices.T
    assert inside.min() > -1e-3
    assert inside.max() < 1 + 1e-3
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    behind = np.einsum("ij,ij->i", normal, origin - corners[:, 0]) < 0
    np.testing.assert_array_equal(patches.side == 1, behind)


@vectorized
@pytest.mark.parametrize("frames", [1, 7, 1000])
def test_a_survey_counts_512_rays_per_pixel_however_long_the_sequence(frames):
    activate(choose_variant())
    floor = triangle_mesh([[[-900, -900, 0], [900, -900, 0], [0, 900, 0]]])
    loaded = load_scene(THING, [floor])
    down = Trajectory(frames=frames, position_m=(0, 0, 2), look_at_m=(0, 0, 0), up=(1, 0, 0))
    cells = Cells.of([floor], CAMERA, down.poses()[:, :3, 3])
    rays = views(CAMERA, down.poses(), VIEWS, 0)
    seen, _ = survey(loaded, CellFinder(cells, loaded), cells.count, rays)
    assert seen.sum() == 512 * CAMERA.width * CAMERA.height
    assert not seen[cells.count // 2 :].any()  # the back
