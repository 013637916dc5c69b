"""Label maps and point tracks of a rendered sequence (docs/how-to/labels.md lists the files).

Instances are coded as in COCO's panoptic format, tracks as in TAP-Vid (Doersch et al., NeurIPS
2022): `query_points` (N, 3): frame, y, x; `points` (N, T, 2): x, y in px; `occluded` (N, T).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.config.rendering import TrackSettings
from megalopta.core import bounded, files
from megalopta.core.errors import UserError
from megalopta.core.pictures import write_codes
from megalopta.dataset.store import Dataset

if TYPE_CHECKING:
    from megalopta.render import Tracks, Truth

_LARGEST = 2**16 - 1
MOST_CLASSES = _LARGEST
"""Most kinds of objects that a map of classes can tell apart."""


class PointTracks(NamedTuple):
    """Points followed through T frames."""

    query_points: NDArray[np.float32]
    """(N, 3): frame in which each is seen, from 0, and its y and x there (px)."""
    points: NDArray[np.float32]
    """(N, T, 2): x and y (px); NaN where undefined."""
    occluded: NDArray[np.bool_]
    """(N, T): True where hidden or out of the image."""


def write_labels(
    dataset: Dataset, index: int, truth: "Truth", leaf_clusters: NDArray[np.uint32] | None
) -> None:
    """Write the label maps of a frame that follow from its truth, and its leaf clusters (H, W)."""
    labels = dataset.configuration.labels
    if "classes" in labels:
        write_codes(dataset.frame("training/classes", index), truth.kind_id.astype(np.uint16))
    if "instances" in labels:
        write_codes(dataset.frame("training/instances", index), _in_colors(truth.object_id))
    if leaf_clusters is not None:
        write_codes(dataset.frame("training/clusters", index), _in_colors(leaf_clusters))
    if "normals" in labels:
        share = np.rint((truth.normal.astype(np.float64) + 1) / 2 * _LARGEST)
        share = np.where(np.isnan(share), 0, share)
        write_codes(dataset.frame("training/normals", index), share.astype(np.uint16))


def _in_colors(number: NDArray[np.uint32]) -> NDArray[np.uint8]:
    """Colors (H, W, 3) of numbers (H, W), as in COCO's panoptic format."""
    code = number[..., np.newaxis] >> np.array([0, 8, 16], np.uint32)
    return (code & 255).astype(np.uint8)


def write_tracks(path: Path, settings: TrackSettings, by_frame: Sequence["Tracks"]) -> None:
    """Write the tracks of the points of each frame."""
    queries = [
        np.insert(tracks.points[:, frame, ::-1], 0, frame, axis=1)
        for frame, tracks in zip(settings.frames, by_frame, strict=True)
    ]
    stored = PointTracks(
        np.concatenate(queries).astype(np.float32),
        np.concatenate([tracks.points for tracks in by_frame]).astype(np.float32),
        np.concatenate([tracks.occluded for tracks in by_frame]),
    )
    with files.atomic_write(path) as temporary:
        np.savez(temporary, **stored._asdict())


def read_tracks(path: Path) -> PointTracks:
    """Read tracks. Raises UserError if there are none, or the file is damaged."""
    if not path.exists():
        raise UserError(f"{path}: no tracks; render with `tracks: {{}}`")
    with bounded.undamaged(path, "render again"):
        return PointTracks(*bounded.zipped_arrays(path, PointTracks._fields).values())
