import numpy as np

from megalopta.assets_gen.surface import Surface


def triangle(normals=None):
    return Surface(np.eye(3), np.array([[0, 1, 2]]), np.eye(3)[:, :2], normals)


def test_meshes_carry_uv_and_given_normals():
    normals = np.roll(np.eye(3), 1, axis=0)
    mesh = triangle(normals).to_mesh()
    assert mesh.metadata["smooth"] is True
    np.testing.assert_array_equal(mesh.vertex_normals, normals)
    np.testing.assert_array_equal(mesh.visual.uv, np.eye(3)[:, :2])
