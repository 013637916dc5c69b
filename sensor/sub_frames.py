"""Light between rendered frames: moved along the true flow, for events and bursts of short frames.

A point at x in frame t and at x + F(x) in frame t + 1 is at x + a·F(x) in between, for a from 0 to
1. A pixel's light is looked up in both frames and mixed with weights 1 − a and a; if the point is
occluded in the next frame, or leaves it, in the earlier frame alone. Newly visible light is that of
frame t + 1. Light is interpolated bilinearly, which softens detail finer than two pixels. The
motion is straight and uniform between two frames.
"""

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from megalopta.core.arrays import Floats, Mask


class Following(Protocol):
    """Frames towards which the light of some frames moves."""

    def between(self, frames: NDArray[Any], frame: int, shares: Floats) -> NDArray[np.floating]:
        """Return the radiance (S, H, W, B) at fractions of the way from one frame to the next."""

    def scaled(self, factor: NDArray[np.floating]) -> "Following":
        """Return the same motion of light scaled by a factor, (B,)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NextFrames:
    """Next frame of each of some frames, and the flow to it."""

    radiance: NDArray[Any]
    """(T, H, W, B): radiance of each next frame."""
    flow: NDArray[Any]
    """(T, H, W, 2): forward flow, px, +x right and +y down; where undefined, the light stays."""
    hidden: Mask
    """(T, H, W): True for pixels occluded in the next frame."""

    def scaled(self, factor: NDArray[np.floating]) -> "NextFrames":
        """Return the same motion with light multiplied by a factor per band, (B,)."""
        return replace(self, radiance=self.radiance * factor)

    def between(self, frames: NDArray[Any], frame: int, shares: Floats) -> Floats:
        """Return the radiance (S, H, W, B) at fractions of the way from one frame to the next."""
        flow, gone = self.flow[frame], self.hidden[frame].astype(np.float64)
        motion = np.where(np.isfinite(flow).all(axis=-1, keepdims=True), flow, 0.0)
        found = np.empty((len(shares), *frames.shape[1:]))
        for band in range(frames.shape[-1]):
            pair = frames[frame, ..., band], self.radiance[frame, ..., band]
            for part, share in enumerate(shares):
                found[part, ..., band] = _at(*pair, motion, gone, share)
        return found


def sub_frames(
    frames: NDArray[Any],
    flow: NDArray[Any],
    parts: int,
    hidden: Mask | None = None,
) -> Floats:
    """Return light in the middle of each equal part of the time between frames.

    Raises ValueError if the shapes do not match.

    Parameters
    ----------
    frames : (T, H, W)
        Light or detection rate, two frames or more.
    flow : (T − 1, H, W, 2)
        Forward flow, px, +x right and +y down; where undefined, the light stays.
    parts : int
        1 or more.
    hidden : (T − 1, H, W), optional
        True for pixels occluded in the next frame.

    Returns
    -------
    (T − 1, parts, H, W)
    """
    if frames.ndim != 3 or flow.shape != (len(frames) - 1, *frames.shape[1:], 2) or parts < 1:
        raise ValueError(
            f"frames {frames.shape}, flow {flow.shape}, parts {parts}: give (T, H, W), "
            "(T − 1, H, W, 2) and 1 or more"
        )
    hidden = np.zeros(flow.shape[:3], np.bool_) if hidden is None else hidden
    following = NextFrames(radiance=frames[1:, ..., None], flow=flow, hidden=hidden)
    middles = (np.arange(parts) + 0.5) / parts
    parts_of = (
        following.between(frames[..., None], index, middles)[..., 0] for index in range(len(flow))
    )
    return np.stack(list(parts_of))


def _at(before: Floats, after: Floats, flow: Floats, gone: Floats, share: float) -> Floats:
    """Light at a fraction of the way from one frame to the next."""
    grid = np.indices(before.shape, dtype=np.float64)
    along = flow[..., ::-1].transpose(2, 0, 1)  # rows, columns
    moved = along
    for _ in range(3):  # the flow of the point that is here now, not before
        moved = np.stack([_look_up(each, grid - share * moved) for each in along])
    start, end = grid - share * moved, grid + (1 - share) * moved
    size = np.array(before.shape)[:, None, None] - 1
    leaves = ((end < 0) | (end > size)).any(axis=0) | (_look_up(gone, start) > 0.5)
    enters = ((start < 0) | (start > size)).any(axis=0)
    weight = np.where(leaves & ~enters, 0.0, np.where(enters & ~leaves, 1.0, share))
    return (1 - weight) * _look_up(before, start) + weight * _look_up(after, end)


def _look_up(image: NDArray[Any], places: Floats) -> Floats:
    values = map_coordinates(np.asarray(image, np.float64), places, order=1, mode="nearest")
    return np.asarray(values)
