"""Ground truth in the file formats of MPI-Sintel, for its unmodified loaders.

Depth (.dpt) and camera (.cam) files start with the float32 tag 202021.25. Sintel has pixel centers
at integers, half a pixel less than our continuous image coordinates.

Disparity between two cameras side by side is focal length (px) × baseline / depth, ≥ 0: a point at
column x of the left image is at column x − disparity of the right one.

- Sintel: 8-bit RGB PNG, red·4 + green/2⁶ + blue/2¹⁴ px (its stereo package). Here white is unknown:
  1024 px and more.
- KITTI: 16-bit gray PNG, disparity·256; 0 is unknown (Menze and Geiger, CVPR 2015).
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from megalopta.core.files import atomic_write
from megalopta.core.pictures import opened_picture, write_codes
from megalopta.dataset.store import Dataset
from megalopta.flow.formats import write_flo

if TYPE_CHECKING:
    from megalopta.render import Flow, Truth

TAG = np.float32(202021.25)
_SINTEL_PER_PX, _SINTEL_CODES = 2**14, 2**24
_UNKNOWN = 255
_KITTI_PER_PX, _KITTI_CODES = 256, 2**16
SKY_DEPTH_M = 1e10
"""Value of Blender, which rendered Sintel: readers compute means or 1/depth, or apply a limit."""


def write_png(path: Path, image: NDArray[np.uint8]) -> None:
    """Write an 8-bit image (H, W) or (H, W, 3)."""
    with atomic_write(path) as temporary:
        Image.fromarray(image).save(temporary)


def write_depth(path: Path, depth: NDArray[np.float32]) -> None:
    """Write a .dpt file of depth (H, W) in m; the sky's infinite depth becomes finite."""
    height, width = depth.shape
    stored = np.where(np.isinf(depth), SKY_DEPTH_M, depth)
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        file.write(TAG.tobytes())
        file.write(np.array([width, height], "<i4").tobytes())
        file.write(np.ascontiguousarray(stored, "<f4").tobytes())


def write_camera(path: Path, intrinsics: NDArray[np.float64], pose: NDArray[np.float64]) -> None:
    """Write a .cam file: a pinhole's intrinsics (3, 3), and world-to-camera extrinsics (3, 4)."""
    # In Sintel the center of the first pixel is at 0.
    intrinsics = intrinsics - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    extrinsics = np.linalg.inv(pose)[:3]
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        file.write(TAG.tobytes())
        file.write(np.ascontiguousarray(intrinsics, "<f8").tobytes())
        file.write(np.ascontiguousarray(extrinsics, "<f8").tobytes())


def write_flow(dataset: Dataset, index: int, truth: "Truth") -> None:
    """Write forward flow (.flo) of a frame, with masks of unmatched and undefined pixels.

    Unmatched ("occlusions") means hidden in the next frame or out of view; a panorama has no left
    or right border.
    """
    from megalopta.render import out_of_view

    flow, wraps = truth.flow_forward, dataset.configuration.camera.wraps
    undefined = np.asarray(np.isnan(flow).any(axis=-1))
    unmatched: NDArray[np.bool_] = truth.occluded_forward | out_of_view(flow, wraps)
    write_flo(dataset.frame("training/flow", index), flow)
    write_png(dataset.frame("training/occlusions", index), mask_of(unmatched))
    write_png(dataset.frame("training/invalid", index), mask_of(undefined))


def mask_of(flags: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the 8-bit image (H, W) of flags (H, W): 255 where True."""
    return np.where(flags, 255, 0).astype(np.uint8)


def write_disparity(dataset: Dataset, index: int, flow: "Flow", baseline_m: float) -> None:
    """Write the disparity of a frame, and a mask of pixels hidden from the other camera.

    The flow leads to the other camera, at a baseline (m, positive to the right). The mask also has
    pixels out of the other camera's view, and those of unknown disparity.
    """
    # A point at infinity has a disparity of 0, to rounding.
    disparity = np.maximum(-np.sign(baseline_m) * flow.displacement[..., 0], 0)
    exact = np.rint(disparity.astype(np.float64) * _SINTEL_PER_PX)
    code = np.minimum(exact, _SINTEL_CODES - 1).astype(np.uint32)
    codes = np.stack([code >> 16, code >> 8 & 255, code & 255], axis=-1).astype(np.uint8)
    write_png(dataset.frame("training/disparities", index), codes)
    unmatched = flow.occluded | flow.out_of_view | (codes == _UNKNOWN).all(axis=-1)
    write_png(dataset.frame("training/occlusions_stereo", index), mask_of(unmatched))


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
