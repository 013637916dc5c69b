"""Whether packed frames were unpacked the right way, by how well neighboring pixels fit.

Bits reversed within each byte leave neighbors in a byte neighbors, but across the border of two
bytes they bring pixels together that are 15 apart: the mean by column gets a period of 8. A picture
is smoother the right way; noise and hot pixels weigh the same both ways, so of a flat image nothing
is said. Three parts in a hundred, and six standard deviations of noise, must be between the two.
"""

import numpy as np
from numpy.typing import NDArray

Bits = NDArray[np.uint8]
Image = NDArray[np.float64]

_MOST_FRAMES = 256
_LEAST_DIFFERENCE = 0.03
_SIGMAS = 6.0
# Of a sign test: false alarm 1e-6.
_SIGN_SIGMAS = 4.8
_BANDS = 8


def is_reversed(bits: Bits) -> bool:
    """Whether the bits of (T, H, W) frames, packed along the width, seem to be reversed."""
    image = _mean_image(bits[:, :, : bits.shape[2] // 8 * 8])
    other = image.reshape(image.shape[0], -1, 8)[:, :, ::-1].reshape(image.shape)
    return _is_smoother(other, image) or _are_borders_rough(image)


def is_packed_along_height(packed: Bits) -> bool:
    """Whether bytes (T, H, W/8) seem to hold eight pixels of a column, not of a row."""
    frames, rows, bytes_per_row = packed.shape
    if rows % 8:
        return False
    thinned = packed[:: max(1, frames // _MOST_FRAMES)]
    turned = thinned.reshape(-1, rows // 8, 8 * bytes_per_row)
    along_width = _mean_image(np.unpackbits(thinned, axis=2))
    along_height = _mean_image(np.unpackbits(turned, axis=1))
    return _is_smoother(along_height, along_width)


def _mean_image(bits: Bits) -> Image:
    return np.asarray(bits[:: max(1, len(bits) // _MOST_FRAMES)].mean(axis=0, dtype=np.float64))


def _is_smoother(one: Image, other: Image) -> bool:
    """Whether neighbors differ less in one image than in the other, beyond noise."""
    noise = _SIGMAS * 2.5 / np.sqrt(max(one.size, 1))
    return bool(_roughness(other) > _roughness(one) * (1 + _LEAST_DIFFERENCE + noise))


def _roughness(image: Image) -> float:
    """Mean square of the differences of neighbors."""
    return float(sum(np.mean(np.diff(image, axis=axis) ** 2) for axis in (0, 1) if image.size))


def _are_borders_rough(image: Image) -> bool:
    """Whether pixels 15 apart, of two bytes, fit better than those that meet at their border.

    One vote a border, of column means in bands of rows, so that a column that differs in all of its
    rows has no more than its two.
    """
    bands = np.array([band.mean(axis=0) for band in np.array_split(image, _BANDS) if len(band)])
    first, second = (part.reshape(len(bands), -1, 8) for part in (bands[:, :-8], bands[:, 8:]))
    meeting = np.sum((first[:, :, 7] - second[:, :, 0]) ** 2, axis=0)
    ends = np.sum((first[:, :, 0] - second[:, :, 7]) ** 2, axis=0)
    rough = np.count_nonzero(meeting > ends)
    return bool(rough > meeting.size / 2 + _SIGN_SIGMAS / 2 * np.sqrt(meeting.size))
