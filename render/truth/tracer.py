"""Ground truth of one frame from rays through the pixel centers, and of the pixels around them.

A surface point P is found by the renderer's own geometry, in float64 (`geometry`); its flow is
where the other camera sees P as it is at the other frame's time, minus the pixel center. Points at
infinity (the sky) move by rotation alone. Whether the other camera sees P is decided by a
visibility ray against the geometry of that time, not by comparing depths, which misjudges more
pixels than are truly hidden. Nor does a camera see a point of a leaf that it has the other side of.

Flow is in px of the stored image, +x right, +y down; NaN where the other camera has no image of the
point, as behind a pinhole. The other frame may be any of the sequence.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask
from megalopta.render.truth.footprint import Footprint, Footprints
from megalopta.render.truth.geometry import Geometry, Surface, correspondence
from megalopta.render.truth.views import View
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.scene import Scene


@dataclass(frozen=True)
class Flow:
    """Where the points that one frame sees are in another (H, W)."""

    displacement: NDArray[np.float32]
    """(H, W, 2): way (x, y) in px; NaN where undefined."""
    occluded: Mask
    """(H, W): whether something, or the leaf that it is on, is between point and other camera."""
    out_of_view: Mask
    """(H, W): whether the point leaves the image, or has no flow."""


@dataclass(frozen=True)
class Truth:
    """What is known about one frame (H, W): exactly, of the pixel centers, but for `footprint`."""

    depth: NDArray[np.float32]
    """(H, W): distance along the optical axis, in panoramas along the ray, m; infinite for the
    sky."""
    position: Floats
    """(H, W, 3): world position of what the pixel center sees, m; NaN for the sky."""
    normal: NDArray[np.float32]
    """(H, W, 3): geometric unit normal in world axes, toward the camera; NaN for the sky."""
    object_id: NDArray[np.uint32]
    """(H, W): index into `Scene.placements` plus one; 0 for the sky."""
    kind_id: NDArray[np.uint32]
    """(H, W): index into `Scene.kinds` plus one; 0 for the sky."""
    flow_forward: NDArray[np.float32]
    flow_backward: NDArray[np.float32]
    """(H, W, 2): displacement (x, y) in px to the next and to the previous frame; NaN where
    undefined, everywhere when there is no such frame."""
    occluded_forward: Mask
    occluded_backward: Mask
    """(H, W): whether something, or the leaf that it is on, is between the point and the camera of
    the next or previous frame."""
    out_of_view_forward: Mask
    out_of_view_backward: Mask
    """(H, W): whether the point leaves the image, or has no flow."""
    footprint: Footprint
    """What the whole pixels see, from rays spread over them."""


class TruthTracer:
    """Traces the truth of a scene's frames, that of whole pixels with some rays for each."""

    def __init__(self, scene: Scene, geometry: Geometry, camera: Camera, rays: int) -> None:
        self._geometry = geometry
        self._camera = camera
        self._origin = np.asarray(scene.origin_m)
        kind_ids = {kind: index + 1 for index, kind in enumerate(scene.kinds)}
        kinds = [0, *(kind_ids[placement.kind] for placement in scene.placements)]
        self._kind_of_object = np.array(kinds, np.uint32)
        self._axes = camera.directions().reshape(-1, 3)
        self._image = camera.pixel_centers().reshape(-1, 2)
        self._footprints = Footprints(geometry, camera, rays)

    def truth(self, view: View, following: View | None, previous: View | None) -> Truth:
        """Ground truth of a frame, with flow toward the next and the previous one, if any."""
        shape = self._camera.height, self._camera.width
        surface = self._see(view)
        object_id = self._geometry.object_id[surface.triangle].reshape(shape)
        position = np.where(surface.is_sky[:, None], np.nan, surface.points + self._origin)
        way = surface.points - view.pixels(self._camera).origin
        distance = np.where(surface.is_sky, np.inf, np.linalg.norm(way, axis=-1))
        forward, backward = self._flow(surface, following), self._flow(surface, previous)
        return Truth(
            depth=self._camera.depth(distance.reshape(shape)).astype(np.float32),
            position=position.reshape(*shape, 3),
            normal=self._geometry.normal(surface).reshape(*shape, 3).astype(np.float32),
            object_id=object_id,
            kind_id=self._kind_of_object[object_id],
            flow_forward=forward.displacement,
            flow_backward=backward.displacement,
            occluded_forward=forward.occluded,
            occluded_backward=backward.occluded,
            out_of_view_forward=forward.out_of_view,
            out_of_view_backward=backward.out_of_view,
            footprint=self._footprints.footprint(view, following, previous, object_id),
        )

    def flow(self, view: View, other: View) -> Flow:
        """Where the points that one frame sees are in another frame."""
        return self._flow(self._see(view), other)

    def _see(self, view: View) -> Surface:
        eyes = view.pixels(self._camera)
        return self._geometry.seen(eyes.origin, eyes.to_world(self._axes), eyes.time_s)

    def _flow(self, surface: Surface, other: View | None) -> Flow:
        shape = self._camera.height, self._camera.width
        if other is None:
            nowhere = np.full((*shape, 2), np.nan, np.float32)
            return Flow(nowhere, np.zeros(shape, bool), np.ones(shape, bool))
        found = correspondence(self._geometry, self._camera, surface, self._image, other)
        flow = found.displacement.reshape(*shape, 2).astype(np.float32)
        wraps = self._camera.wraps
        return Flow(flow, found.is_hidden.reshape(shape), out_of_view(flow, wraps))


def out_of_view(flow: NDArray[np.float32], wraps: bool = False) -> Mask:
    """Whether a pixel's point (H, W) leaves the image along its flow (H, W, 2), or has no flow.

    An image that wraps around has no left and right edge to leave by.
    """
    height, width = flow.shape[:2]
    x = np.arange(width) + 0.5 + flow[..., 0]
    y = np.arange(height)[:, None] + 0.5 + flow[..., 1]
    inside = np.isfinite(x) if wraps else (x >= 0) & (x <= width)
    return np.asarray(~(inside & (y >= 0) & (y <= height)))
