"""Ground truth of a frame, from rays through pixel centers and over whole pixels.

The flow of a surface point is its image in the other camera at the other frame's time, minus the
pixel center; the sky moves by rotation alone. Flow is in px of the stored image, +x right, +y down;
NaN where the other camera has no image of the point. A visibility ray decides whether that camera
sees the point. A point of a leaf is also invisible to a camera on the leaf's other side.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask, bilinear
from megalopta.render.loading.meshes import MergedMesh
from megalopta.render.settings import Bands
from megalopta.render.truth.footprint import Footprint, Footprints
from megalopta.render.truth.geometry import (
    Geometry,
    Instant,
    Surface,
    View,
    correspondence,
    of_rays,
)
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.material import ColorTexture, Material
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectra.color import band_means


@dataclass(frozen=True)
class Flow:
    """Displacement of the points of one frame in another (H, W)."""

    displacement: NDArray[np.float32]
    """(H, W, 2): displacement (x, y) in px; NaN where undefined."""
    occluded: Mask
    """(H, W): True if something, or the point's own leaf, is between point and other camera."""
    out_of_view: Mask
    """(H, W): True if the point leaves the image, or has no flow."""


@dataclass(frozen=True)
class Tracks:
    """Image positions of N points in T frames."""

    points: Floats
    """(N, T, 2): image coordinates (x, y) in px; NaN where undefined."""
    occluded: Mask
    """(N, T): True if the point is hidden from the frame's camera, or out of its image."""


@dataclass(frozen=True)
class Truth:
    """Ground truth of one frame (H, W), exact at pixel centers except for `footprint`."""

    depth: NDArray[np.float32]
    """(H, W): distance along the optical axis, in panoramas along the ray, m; infinite for the
    sky."""
    position: Floats
    """(H, W, 3): world position at the pixel center, m; NaN for the sky."""
    normal: NDArray[np.float32]
    """(H, W, 3): geometric unit normal in world axes, toward the camera; NaN for the sky."""
    object_id: NDArray[np.uint32]
    """(H, W): index into `Scene.placements` plus one; 0 for the sky."""
    kind_id: NDArray[np.uint32]
    """(H, W): index into `Scene.kinds` plus one; 0 for the sky."""
    flow_forward: NDArray[np.float32]
    flow_backward: NDArray[np.float32]
    """(H, W, 2): displacement (x, y) in px to the next and to the previous frame; NaN where
    undefined, everywhere if there is no such frame."""
    occluded_forward: Mask
    occluded_backward: Mask
    """(H, W): True if something, or the point's own leaf, is between the point and the camera of
    the next or previous frame."""
    out_of_view_forward: Mask
    out_of_view_backward: Mask
    """(H, W): True if the point leaves the image, or has no flow."""
    footprint: Footprint
    """Truth of whole pixels, from rays spread over them."""
    blur: NDArray[np.float32] | None = None
    """(H, W): radius of the disc to which the lens blurs the point at the pixel center, px; None
    for a camera without a lens."""


class TruthTracer:
    """Tracer of the truth of a scene's frames, with some rays per pixel for whole pixels."""

    def __init__(self, scene: Scene, geometry: Geometry, camera: Camera, rays: int) -> None:
        self._geometry = geometry
        self._camera, self._wraps = camera, camera.wraps
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
        surface = self.see(view)
        object_id = self._geometry.object_id[surface.triangle].reshape(shape)
        position = np.where(surface.is_sky[:, None], np.nan, surface.points + self._origin)
        way = surface.points - view.pixels(self._camera).origin
        distance = np.where(surface.is_sky, np.inf, np.linalg.norm(way, axis=-1))
        forward, backward = self._flow(surface, following), self._flow(surface, previous)
        depth = self._camera.depth(distance.reshape(shape))
        return Truth(
            depth=depth.astype(np.float32),
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
            blur=self._camera.blur_px(depth),
        )

    def flow(self, view: View, other: View) -> Flow:
        """Displacement of one frame's points in another frame."""
        return self._flow(self.see(view), other)

    def tracks(self, view: Instant, others: Iterable[View], image: Floats) -> Tracks:
        """Follow the points that a frame sees at image coordinates (N, 2) through other frames."""
        eyes = view.pixels(self._camera)
        directions = eyes.to_world(self._camera.toward(image))
        surface = self._geometry.seen(eyes.origin, directions, eyes.time_s)
        size = np.array([self._camera.width, self._camera.height])
        points, occluded = [], []
        for seen_at in others:
            way, is_hidden = correspondence(self._geometry, self._camera, surface, image, seen_at)
            place = image + way
            if self._wraps:
                place[:, 0] %= size[0]
            points.append(place)
            occluded.append(is_hidden | ~((place >= 0) & (place <= size)).all(axis=1))
        return Tracks(np.stack(points, axis=1), np.stack(occluded, axis=1))

    def see(self, view: View) -> Surface:
        """Surface seen through the centers of all pixels, row by row."""
        eyes = view.pixels(self._camera)
        return self._geometry.seen(eyes.origin, eyes.to_world(self._axes), eyes.time_s)

    def _flow(self, surface: Surface, other: View | None) -> Flow:
        shape = self._camera.height, self._camera.width
        if other is None:
            nowhere = np.full((*shape, 2), np.nan, np.float32)
            return Flow(nowhere, np.zeros(shape, bool), np.ones(shape, bool))
        way, is_hidden = correspondence(self._geometry, self._camera, surface, self._image, other)
        flow = way.reshape(*shape, 2).astype(np.float32)
        return Flow(flow, is_hidden.reshape(shape), out_of_view(flow, self._wraps))


def out_of_view(flow: NDArray[np.float32], wraps: bool = False) -> Mask:
    """True if a pixel's point (H, W) leaves the image along its flow (H, W, 2), or has no flow.

    Points cannot leave an image that wraps around at its left and right edge.
    """
    height, width = flow.shape[:2]
    x = np.arange(width) + 0.5 + flow[..., 0]
    y = np.arange(height)[:, None] + 0.5 + flow[..., 1]
    inside = np.isfinite(x) if wraps else (x >= 0) & (x <= width)
    return np.asarray(~(inside & (y >= 0) & (y <= height)))


def albedo_of(
    surface: Surface,
    geometry: Geometry,
    meshes: Sequence[MergedMesh],
    materials: Mapping[str, Material],
    bands_nm: Bands,
) -> Floats:
    """Albedo (N, B) of the surface points seen by N rays.

    It is 0 for the sky, for emitters and for surfaces that are not diffuse.
    """
    albedo = np.zeros((len(surface.triangle), len(bands_nm)))
    ends = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
    mesh_of = np.searchsorted(ends, surface.triangle, side="right") - 1
    for number, mesh in enumerate(meshes):
        mine = np.flatnonzero(mesh_of == number)
        material = materials[mesh.material]
        if not len(mine) or material.emission or material.finish:
            continue
        spectra = [material.reflectance]
        if material.texture:
            spectra += [reflectance for reflectance, _ in material.texture.spectra]
        base, *parts = band_means(spectra, bands_nm)
        albedo[mine] = base
        if material.texture and mesh.uv is not None:
            triangle, time_s = surface.triangle[mine], of_rays(surface.time_s, mine)
            u, v = geometry.inside(triangle, surface.points[mine], time_s).T[..., None]
            first, second, third = np.moveaxis(mesh.uv[mesh.faces[triangle - ends[number]]], 1, 0)
            uv = (1 - u - v) * first + u * second + v * third
            texels = material.texture.weight.astype(np.float64)
            weight = bilinear(texels, *(uv * texels.shape[1::-1] - 0.5).T)
            is_sum = isinstance(material.texture, ColorTexture)
            # A texture of colors is on a black surface, another is mixed with the first spectrum.
            albedo[mine] += weight @ (np.array(parts) - (0 if is_sum else base))
    return albedo
