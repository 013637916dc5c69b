import numpy as np
import pytest

from megalopta.assets_gen import TEXTURES

from .conftest import seam_contrast

ATLASES = {"leaf", "needles"}  # squares of separate leaves, which need not tile


@pytest.mark.parametrize("name", TEXTURES)
def test_textures_are_weights_with_contrast_at_every_scale_and_without_a_seam(name):
    texture = TEXTURES[name](np.random.default_rng(7))
    assert texture.dtype == np.float32
    assert texture.min() >= 0 and texture.max() <= 1
    if name not in ATLASES:
        # a step across the seam is no larger than the largest between any two rows inside
        assert max(seam_contrast(texture, axis) for axis in (0, 1)) <= 1.05
    image = texture.astype(float)
    while min(image.shape) > 32:
        blocks = image.reshape(image.shape[0] // 2, 2, image.shape[1] // 2, 2)
        coarse = blocks.mean(axis=(1, 3))
        assert (image - coarse.repeat(2, axis=0).repeat(2, axis=1)).std() > 0.02
        image = coarse
