"""Pictures of colors on surfaces, decoded within bounds."""

import io

import numpy as np
from numpy.typing import NDArray

from megalopta.core.errors import DamagedFileError
from megalopta.core.pictures import decoded
from megalopta.scenes.spectra.color import linear_of_srgb

MOST_PIXELS = 2**26
"""Most pixels of a picture, which takes 0.8 GB as light."""


def linear_picture(content: bytes, material: str) -> NDArray[np.float32]:
    """Return colors (H, W, 3) in linear sRGB of a material's picture; row 0 is at v = 0, below.

    Raises DamagedFileError.
    """
    name = f"the picture of material {material!r}"
    with decoded(io.BytesIO(content), name) as image:
        width, height = image.size
        if width * height > MOST_PIXELS:
            raise DamagedFileError(
                f"{name} has {width} × {height} pixels, more than {MOST_PIXELS:.3g}; shrink it"
            )
        if image.mode.startswith("I;16"):
            return _colors(np.asarray(image)[..., None] / 65535)
        return _of_codes(np.asarray(image.convert("RGB")))


def _of_codes(codes: NDArray[np.uint8]) -> NDArray[np.float32]:
    table = linear_of_srgb(np.arange(256) / 255).astype(np.float32)
    return np.ascontiguousarray(table[codes[::-1]])


def _colors(curved: NDArray[np.float64]) -> NDArray[np.float32]:
    return linear_of_srgb(curved[::-1].repeat(3, axis=-1)).astype(np.float32)
