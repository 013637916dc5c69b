import numpy as np
import pytest

from megalopta.assets_gen.plants.bark import TILE_M
from megalopta.assets_gen.plants.furrows import CARVED_M, Furrows
from megalopta.assets_gen.plants.tube import sweep
from megalopta.assets_gen.surface_textures import TEXTURES

RADIUS_M, DEPTH_M = 0.2, 0.02
AXIS = np.array([[0, 0, -0.35], [0, 0, 0], [0, 0, 0.5], [0.1, 0, 3], [0.1, 0, 6], [0.1, 0, 7]])
PROFILE = np.full((5, 12), RADIUS_M)
ORIGIN = np.array([0.3, 0.7])


@pytest.fixture(scope="module")
def furrows():
    return Furrows(TEXTURES["ridged"](np.random.default_rng(1)), DEPTH_M)


@pytest.fixture(scope="module")
def carved(furrows):
    return furrows.carved(AXIS, PROFILE, TILE_M, ORIGIN)


def test_a_carved_stem_keeps_its_mean_radius(carved):
    axis, profile = carved
    rough = (axis[:-1, 2] > 0) & (axis[:-1, 2] < CARVED_M[0])
    # Around 0.9 m² of bark with patches of half a meter the mean of a pattern varies by a tenth.
    assert profile[rough].mean() == pytest.approx(RADIUS_M, abs=0.1 * DEPTH_M)
    assert 0.05 * DEPTH_M < profile[rough].std() < 0.5 * DEPTH_M
    assert np.ptp(profile) <= DEPTH_M


def test_what_is_painted_dark_lies_deep(furrows, carved):
    axis, profile = carved
    surface = sweep(axis, profile, TILE_M, ORIGIN, whole_tiles=True)
    sides = profile.shape[1]
    uv = surface.uv[:-1].reshape(-1, sides + 1, 2)[:, :-1]
    rows, columns = furrows.pattern.shape
    row, column = (
        (uv[..., 1] * rows).astype(int) % rows,
        (uv[..., 0] * columns).astype(int) % columns,
    )
    rough = (axis[:-1, 2] > 0) & (axis[:-1, 2] < CARVED_M[0])
    paint = furrows.pattern[row, column][rough].ravel()
    # Grain finer than the mesh is painted only.
    assert np.corrcoef(paint, -profile[rough].ravel())[0, 1] > 0.7
