"""Disparity between two cameras side by side, in the layouts of MPI-Sintel and KITTI.

Disparity is focal length (px) × baseline / depth, ≥ 0: a point at column x of the left image is at
column x − disparity of the right one.

- Sintel: 8-bit RGB PNG, red·4 + green/2⁶ + blue/2¹⁴ px (its stereo package). Here white is unknown:
  1024 px and more.
- KITTI: 16-bit gray PNG, disparity·256; 0 is unknown (Menze and Geiger, CVPR 2015).
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from megalopta.core.pictures import opened_picture, write_codes
from megalopta.dataset.sintel import mask_of, write_png
from megalopta.dataset.store import Dataset

if TYPE_CHECKING:
    from megalopta.render import Flow

_SINTEL_PER_PX, _SINTEL_CODES = 2**14, 2**24
_UNKNOWN = 255
_KITTI_PER_PX, _KITTI_CODES = 256, 2**16


def write_disparity(dataset: Dataset, index: int, flow: "Flow", baseline_m: float) -> None:
    """Write the disparity of a frame, and a mask of pixels hidden from the other camera.

    The flow leads to the other camera, at a baseline (m, positive to the right). The mask also has
    pixels out of the other camera's view, and those of unknown disparity.
    """
    # A point at infinity has a disparity of 0, to rounding.
    disparity = np.maximum(-np.sign(baseline_m) * flow.displacement[..., 0], 0)
    codes = sintel_codes(disparity)
    write_png(dataset.frame("training/disparities", index), codes)
    unmatched = flow.occluded | flow.out_of_view | (codes == _UNKNOWN).all(axis=-1)
    write_png(dataset.frame("training/occlusions_stereo", index), mask_of(unmatched))


def sintel_codes(disparity: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Sintel's red, green and blue (H, W, 3) of disparities (H, W), px; white if unknown."""
    exact = np.rint(disparity.astype(np.float64) * _SINTEL_PER_PX)
    code = np.minimum(exact, _SINTEL_CODES - 1).astype(np.uint32)
    return np.stack([code >> 16, code >> 8 & 255, code & 255], axis=-1).astype(np.uint8)


def read_disparity(path: Path) -> NDArray[np.float32]:
    """Read a disparity (H, W), px, in Sintel's layout; NaN if unknown."""
    with opened_picture(path) as image:
        codes = np.asarray(image, dtype=np.float64)
    disparity = codes @ [4, 2**-6, 1 / _SINTEL_PER_PX]
    is_unknown = (codes == _UNKNOWN).all(axis=-1)
    return np.where(is_unknown, np.nan, disparity).astype(np.float32)


def write_kitti_disparity(path: Path, disparity: NDArray[np.floating]) -> None:
    """Write a disparity (H, W), px, in KITTI's layout.

    The smallest code, 1/256 px, also is that of infinity; disparities from 256 px on, and NaN, are
    unknown.
    """
    codes = np.maximum(np.rint(disparity.astype(np.float64) * _KITTI_PER_PX), 1)
    image = np.where(codes < _KITTI_CODES, codes, 0).astype(np.uint16)
    write_codes(path, image)
