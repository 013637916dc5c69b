"""Pictures of colors on surfaces, decoded within bounds."""

import io

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import check_decoded
from megalopta.core.pictures import decoded
from megalopta.scenes.spectra.color import linear_of_srgb

_GRAY = "1", "L", "LA"
TEXEL_BYTES = 40
"""Memory of a pixel of a picture, decoded and loaded (bytes, measured)."""


class Texels:
    """Pictures of one file or scene, which fit into the budget together."""

    def __init__(self, owner: str) -> None:
        self._owner, self._count = owner, 0
        self._pictures: dict[int, NDArray[np.float32]] = {}

    def add(self, picture: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return a picture, which counts once. Raises TooLargeError."""
        if id(picture) not in self._pictures:
            self._pictures[id(picture)] = picture
            self._count += picture.shape[0] * picture.shape[1]
            check_decoded(f"{self._owner} with its pictures", (self._count,), TEXEL_BYTES)
        return picture


def linear_picture(content: bytes, material: str) -> NDArray[np.float32]:
    """Return colors (H, W, 3) in linear sRGB of a material's picture; row 0 is at v = 0, below.

    Raises DamagedFileError.
    """
    texels = texels_of(content, material)[::-1]
    return np.ascontiguousarray(texels if texels.shape[2] > 1 else texels.repeat(3, axis=-1))


def texels_of(content: bytes, material: str, is_coded: bool = True) -> NDArray[np.float32]:
    """Return texels (H, W, 1 or 3) of a material's picture, decoded from sRGB; row 0 is on top.

    Raises DamagedFileError.
    """
    name = f"the picture of material {material!r}"
    with decoded(io.BytesIO(content), name, TEXEL_BYTES) as image:
        if image.mode.startswith("I;16"):
            levels, codes = 2**16, np.asarray(image)
        else:
            levels = 2**8
            codes = np.asarray(image.convert("L" if image.mode in _GRAY else "RGB"))
    values = np.arange(levels) / (levels - 1)
    table = (linear_of_srgb(values) if is_coded else values).astype(np.float32)
    return np.asarray(table[codes.reshape(*codes.shape[:2], -1)])
