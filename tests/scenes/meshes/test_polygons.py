import numpy as np
import pytest
import trimesh

from megalopta.scenes.meshes.polygons import pieces_of

RNG = np.random.default_rng(4)


def ball():
    return trimesh.creation.icosphere(1)


@pytest.mark.parametrize("kind", ["ply", "stl", "stl_ascii"])
def test_triangles_are_those_that_were_written(kind):
    name = "rock.ply" if kind == "ply" else "rock.stl"
    written = ball().export(file_type=kind)
    (piece,) = pieces_of({name: written.encode() if isinstance(written, str) else written})
    assert piece.name == "rock" and len(piece.faces) == len(ball().faces)
    assert trimesh.Trimesh(piece.vertices, piece.faces).volume == pytest.approx(ball().volume, 1e-5)
    assert piece.normals is None


def test_normals_of_a_file_make_a_smooth_surface():
    mesh = ball()
    (piece,) = pieces_of({"a.ply": mesh.export(file_type="ply", vertex_normal=True)})
    np.testing.assert_allclose(piece.normals, mesh.vertex_normals, atol=1e-6)


def test_points_have_no_triangles_and_pictures_are_refused():
    points = trimesh.PointCloud(RNG.random((9, 3))).export(file_type="ply")
    assert not len(pieces_of({"a.ply": points})[0].faces)
    named = (
        ball().export(file_type="ply").replace(b"format", b"comment TextureFile a.png\nformat", 1)
    )
    with pytest.raises(ValueError, match="names a picture"):
        pieces_of({"a.ply": named})
