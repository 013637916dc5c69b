import numpy as np
import pytest

from megalopta.assets_gen import TEXTURES

from .conftest import seam_contrast

ATLASES = {"leaf", "needles"}  # squares of separate leaves, which need not tile


@pytest.fixture(params=TEXTURES, scope="module")
def name(request):
    return request.param


@pytest.fixture(scope="module")
def texture(name):
    return TEXTURES[name](np.random.default_rng(7))


def test_weights_are_float32_in_the_unit_interval(texture):
    assert texture.dtype == np.float32
    assert texture.min() >= 0 and texture.max() <= 1


def test_contrast_is_there_at_every_scale_down_to_the_texel(texture):
    image = texture.astype(float)
    while min(image.shape) > 32:
        blocks = image.reshape(image.shape[0] // 2, 2, image.shape[1] // 2, 2)
        coarse = blocks.mean(axis=(1, 3))
        detail = image - coarse.repeat(2, axis=0).repeat(2, axis=1)
        assert detail.std() > 0.02
        image = coarse


def test_textures_tile_without_a_seam(name, texture):
    if name in ATLASES:
        return
    # a step across the seam is no larger than the largest between any two rows inside
    assert max(seam_contrast(texture, axis) for axis in (0, 1)) <= 1.05
