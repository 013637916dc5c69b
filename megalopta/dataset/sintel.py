"""Ground truth in the file formats of MPI-Sintel, for its unmodified loaders.

Depth (.dpt) and camera (.cam) files start with the float32 tag 202021.25. Sintel has pixel centers
at integers, half a pixel less than our continuous image coordinates.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from megalopta.core.files import atomic_write
from megalopta.dataset.store import Dataset
from megalopta.flow.formats import write_flo

if TYPE_CHECKING:
    from megalopta.render import Truth

TAG = np.float32(202021.25)
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
