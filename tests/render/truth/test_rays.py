"""What rays tell of what they hit, and of having hit nothing."""

import numpy as np

from megalopta.render import mi
from megalopta.render.truth.rays import nearest_hits
from megalopta.render.variant import choose_variant


def test_a_ray_that_hits_nothing_tells_of_nothing_else():
    mi.set_variant(choose_variant().name)
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(5000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # Memory that is not a number, given back for the next launch to take.
    for _ in range(20):
        mi.TensorXf(np.full((2, 5000), np.nan, np.float32))
    hits = nearest_hits(mi.load_dict({"type": "scene"}), np.zeros(3), directions)
    assert np.all(np.isinf(hits.distance))
    for rest in (hits.mesh, hits.triangle):
        np.testing.assert_array_equal(rest, 0)
