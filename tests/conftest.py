"""Fixtures of several folders."""

import numpy as np
import pytest
from PIL import Image

from megalopta.render import mi  # before tests import mitsuba, which chooses a libLLVM itself
from megalopta.scenes.spectra.color import encode_srgb


@pytest.fixture
def picture(tmp_path):
    """Writes an array (H, W, 3) as a picture and returns its path."""

    def write(values, name="forest.exr"):
        mi.set_variant("scalar_spectral")
        path = tmp_path / name
        if name.endswith("png"):
            Image.fromarray(encode_srgb(values)).save(path)
        else:
            mi.Bitmap(np.ascontiguousarray(values, np.float32)).write(str(path))
        return path

    return write
