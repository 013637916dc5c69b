import numpy as np
import pytest

from megalopta.assets_gen.bodies import ball, box, checkerboard


@pytest.mark.parametrize(
    ("body", "volume"), [(box, 1.0), (ball, np.pi / 6)], ids=["box", "ball"]
)  # fmt: skip
def test_bodies_are_closed_face_outward_and_have_their_volume(body, volume):
    mesh = body((2.0, 1.0, 0.5), 0.25).to_mesh()
    # By the divergence theorem; a hole or a face turned inward would show. The ball's facets
    # cut off about (π/48)²/2 of its volume.
    assert mesh.volume == pytest.approx(volume, rel=4e-3)
    np.testing.assert_allclose(mesh.extents, (2.0, 1.0, 0.5), rtol=1e-3)
    assert (np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles_center) > 0).all()


def test_a_ball_s_normals_are_those_of_the_ellipsoid():
    body = ball((2.0, 1.0, 0.5), 0.25)
    gradient = body.vertices / np.array([1.0, 0.5, 0.25]) ** 2
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    np.testing.assert_allclose(body.normals, gradient, atol=1e-12)


def test_a_checkerboard_has_equal_shares_and_changes_at_its_middle():
    board = checkerboard(8)
    assert board.mean() == 0.5
    assert (board[:4, :4] == 0).all()
    assert (board[4:, :4] == 1).all()
