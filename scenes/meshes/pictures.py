"""Pictures of colors on surfaces, decoded within bounds."""

import io
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from megalopta.core.errors import DamagedFileError
from megalopta.core.pictures import decoded
from megalopta.scenes.spectra.color import linear_of_srgb

_GRAY = "1", "L", "LA"
MOST_PIXELS = 2**26
"""Most pixels of a picture, which takes 0.8 GB as light."""
MOST_TEXELS = 2**29
"""Most pixels of all pictures of a scene, which take 6 GB as light."""


def check_texels(pictures: Iterable[NDArray[np.float32] | None], owner: str = "it") -> None:
    """Raise DamagedFileError if pictures, each counted once, have too many pixels in all."""
    sizes = {id(each): each.shape[0] * each.shape[1] for each in pictures if each is not None}
    if sum(sizes.values()) > MOST_TEXELS:
        raise DamagedFileError(
            f"{owner} has pictures of more than {MOST_TEXELS:.3g} pixels in all; shrink them"
        )


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
    with decoded(io.BytesIO(content), name) as image:
        width, height = image.size
        if width * height > MOST_PIXELS:
            raise DamagedFileError(
                f"{name} has {width} × {height} pixels, more than {MOST_PIXELS:.3g}; shrink it"
            )
        if image.mode.startswith("I;16"):
            levels, codes = 2**16, np.asarray(image)
        else:
            levels = 2**8
            codes = np.asarray(image.convert("L" if image.mode in _GRAY else "RGB"))
    values = np.arange(levels) / (levels - 1)
    table = (linear_of_srgb(values) if is_coded else values).astype(np.float32)
    return np.asarray(table[codes.reshape(*codes.shape[:2], -1)])
