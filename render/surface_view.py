"""Surfaces seen by a camera: light paths from its pixels, with objects that may move."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask
from megalopta.render.baking.integrator import BakedLightIntegrator
from megalopta.render.film import Film, FrameExposure
from megalopta.render.loading.meshes import MovingMesh
from megalopta.render.loading.scene import DISC_POINTS, Air, LoadedScene, SceneRays, move_to
from megalopta.render.noise import MeasuredPass
from megalopta.render.path_tracing import PathIntegrator, SplitPaths
from megalopta.render.settings import RenderSettings
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.scene import Lighting
from megalopta.scenes.spectra.spectrum import MAXIMUM_EFFICACY_LM_W, luminous, luminous_efficiency

Integrator: TypeAlias = PathIntegrator | SplitPaths | BakedLightIntegrator

_MORE_HITS = 32
"""Leaves at 0.8 to 1.3 µm are the brightest surfaces: for these, 16 hits miss a thousandth."""
# Height above the surface below the camera: clear of it, but below the blades of grass.
_CLEARANCE_M = 0.02
# Number per point. A uniform sky needs fewer.
_PATHS, _UNEVEN_PATHS = 64**2, 320**2
_V_NM = np.arange(380.0, 770.0)


@dataclass(frozen=True)
class Illuminance:
    """Illuminance of a horizontal plane, lux."""

    position_m: tuple[float, float, float]
    lux: float
    standard_error_lux: float
    """Standard error due to the light paths."""


@dataclass(frozen=True)
class LightSurvey:
    """Illuminance of a scene, in the open and below a camera's path."""

    unshaded: Illuminance
    """Above everything, including haze."""
    ground: tuple[Illuminance, ...]
    """Just above the surface below the camera; empty if there is none."""


class LightMeter:
    """Light meter in a scene that is loaded in the active variant, a spectral one.

    Paths start as the cosine to the vertical, at wavelengths sampled in proportion to V(λ), with
    the `max_depth` of frames. The disc of sun or moon is found by visibility rays toward points of
    it. `air` is the scene's haze.
    """

    def __init__(
        self, scene: Any, lighting: Lighting, max_depth: int, air: Air | None = None
    ) -> None:
        self._scene, self._lighting, self._max_depth, self._air = scene, lighting, max_depth, air
        self._rays = SceneRays(scene)
        self._sun = lighting.sun if max_depth > 1 or air else None
        self._paths = _UNEVEN_PATHS if lighting.patterns or air else _PATHS
        self._integrator = PathIntegrator(max_depth - 1, air)

    def survey(self, positions: Floats) -> LightSurvey:
        """Measure above and below camera positions (N, 3), m."""
        below = []
        for position in positions:
            distances, _, _ = self._rays.nearest(position, np.array([[0.0, 0.0, -1.0]]))
            distance = float(distances[0])
            if np.isfinite(distance):
                below.append(position - [0, 0, max(distance - _CLEARANCE_M, 0)])
        above_haze = LightMeter(self._scene, self._lighting, self._max_depth)
        x, y, z = positions.mean(axis=0)
        box = self._scene.bbox()
        top = float(box.max.z) if box.valid() else z
        return LightSurvey(
            above_haze.measure(np.array([x, y, max(z, top) + 1]), seed=0),
            tuple(self.measure(point, seed=1 + index) for index, point in enumerate(below)),
        )

    def measure(self, position: Floats, seed: int) -> Illuminance:
        """Illuminance of a horizontal plane at a position (3,), m."""
        rng, paths = np.random.default_rng(seed), self._paths
        radius, turn = np.sqrt(rng.random(paths)), 2 * np.pi * rng.random(paths)
        level = radius * np.cos(turn), radius * np.sin(turn)
        upward = np.stack([*level, np.sqrt(np.maximum(1 - radius**2, 0))])
        share = luminous_efficiency(_V_NM + 0.5)
        cumulated = np.concatenate([[0], np.cumsum(share / share.sum())])
        even = (rng.permutation(paths) + rng.random(paths)) / paths
        place = (even + np.arange(4)[:, None] / 4) % 1
        wavelengths = np.interp(place, cumulated, [*_V_NM, _V_NM[-1] + 1])
        step = np.searchsorted(cumulated, place, side="right").clip(1, len(share)) - 1
        weights = luminous_efficiency(wavelengths) * share.sum() / share[step]
        origins = np.broadcast_to(position[:, None], (3, paths))
        light = self._integrator.along(self._scene, origins, upward, wavelengths, seed)
        lux = MAXIMUM_EFFICACY_LM_W * np.pi * (weights * light).mean(axis=0)
        disc_lux = 0.0
        if self._sun is not None:
            toward = self._sun.points(DISC_POINTS)
            hidden = self._rays.is_hidden(position, toward, np.full(DISC_POINTS, np.inf))
            unmet = self._air.transmittance(position, toward) if self._air else np.ones(DISC_POINTS)
            cosine = np.where(hidden, 0, unmet * np.maximum(toward[:, 2], 0)).mean()
            disc_lux = float(luminous(self._sun.irradiance) * cosine)
        return Illuminance(
            tuple(position.tolist()),
            float(lux.mean()) + disc_lux,
            float(lux.std() / math.sqrt(lux.size)),
        )


class SurfaceView:
    """Camera in a loaded scene, with the integrator that finds its light.

    `exposing` is that of frames of many poses, if it is another.
    """

    def __init__(
        self,
        whole: LoadedScene,
        camera: Camera,
        settings: RenderSettings,
        integrator: Integrator,
        exposing: Integrator | None = None,
        air: Air | None = None,
    ) -> None:
        self._exposing = exposing or integrator
        self._scene, self._loaded, self._integrator = whole.scene, whole.loaded, integrator
        self._camera, self._settings, self._air = camera, settings, air
        self._moving = {
            index: mesh for index, mesh in enumerate(whole.meshes) if isinstance(mesh, MovingMesh)
        }
        self._time_s = 0.0
        self._films: dict[tuple[Any, ...], Film] = {}

    @property
    def samples_per_pixel(self) -> int:
        """Light paths per pixel, as rounded by the sampler."""
        return self._film(1).samples_per_pixel

    def move_to(self, time_s: float) -> None:
        """Move moving objects to a time."""
        if time_s == self._time_s or not self._moving:
            return
        for scene in [self._loaded, *([self._air.scene] if self._air else [])]:
            move_to(scene, self._moving, time_s)
        self._integrator.move_to(time_s)
        self._time_s = time_s

    def radiance(self, exposure: FrameExposure) -> NDArray[np.float32]:
        """Radiance (H, W, B) of an exposure.

        Raises FloatingPointError if Mitsuba returns a value that is not finite, and ValueError if a
        pose is outside the haze.
        """
        return _finite(self._taken(exposure, is_measured=False))

    def measured(self, exposure: FrameExposure) -> MeasuredPass:
        """The same, with the data that determines its error."""
        image = self._taken(exposure, is_measured=True)
        bands = len(self._settings.bands_nm)
        radiance, sky, fixed = np.split(image, [bands, bands + 1], axis=-1)
        if not fixed.size:
            return MeasuredPass(_finite(radiance), sky[..., 0])
        groups = fixed.reshape(*sky.shape[:2], -1, bands)
        return MeasuredPass(_finite(radiance), sky[..., 0], groups[:, :, :2], groups[:, :, 2:])

    def light_survey(self, positions: Floats) -> LightSurvey | None:
        """Illuminance above and below positions (N, 3); None if only surfaces emit."""
        lighting = self._scene.lighting
        if lighting is None:
            return None
        meter = LightMeter(self._loaded, lighting, self._settings.max_depth, self._air)
        return meter.survey(positions - self._scene.origin_m)

    def light_left_out(self, pose: Floats, time_s: float) -> Floats:
        """Share of the light of surfaces, by band, that takes too many hits for paths, (B,)."""
        self.move_to(time_s)
        per_pixel = math.ceil(2**15 / (self._camera.width * self._camera.height))  # longer paths
        samples = min(per_pixel, self._settings.samples_per_pixel)
        self._check(pose)
        # The other's sampler serves light: the path tracer is compiled for each.
        settings = self._settings.model_copy(update={"sampler": "independent"})
        film, depth = Film(self._camera, settings, samples), self._settings.max_depth
        short, long = (PathIntegrator(hits, self._air) for hits in (depth, depth + _MORE_HITS))
        light = film.expose(short.render, self._loaded, pose, seed=0)
        longer = film.expose(long.measured, self._loaded, pose, seed=0)
        bands, shows_surfaces = light.shape[-1], longer[..., -1] == 0
        part, all_of_it = (
            image[shows_surfaces, :bands].sum(axis=0, dtype=np.float64) for image in (light, longer)
        )
        kept = np.divide(part, all_of_it, out=np.ones(bands), where=all_of_it > 0)
        return np.asarray(1 - kept)

    def _taken(self, exposure: FrameExposure, is_measured: bool) -> NDArray[np.float32]:
        """Mean over the instants at which moving objects are placed; the camera never stops."""
        is_exposed = exposure.parts[0].poses.ndim > 2  # by many poses
        integrator = self._exposing if is_exposed else self._integrator
        trace = integrator.measured if is_measured else integrator.render
        move_to = self.move_to if integrator is self._integrator else integrator.move_to
        rows = None
        if self._moving and exposure.is_rolling:
            part = exposure.parts[len(exposure.parts) // 2]
            count, lines = part.poses.shape[:2]
            pose, meshes = part.poses[count // 2, lines // 2], list(self._moving.values())
            rows = lines_of_a_pose(meshes, self._camera, pose, part.line_times_s)
        film = self._film(len(exposure.parts), is_exposed, rows, exposure.by_columns)
        images = []
        for part in exposure.parts:
            self._check(part.poses)

            def move(strip: slice, times: Sequence[float] = part.line_times_s) -> None:
                move_to(float(np.mean(times[strip])))

            if rows is None:
                move_to(part.line_times_s[0])
            before = move if rows else None
            images.append(film.expose(trace, self._loaded, part.poses, part.seed, before))
        return np.asarray(np.mean(images, axis=0, dtype=np.float64), dtype=np.float32)

    def _check(self, poses: Floats) -> None:
        """Reject poses (..., 4, 4) outside the haze, from which paths would not start."""
        if self._air and not self._air.holds(poses[..., :3, 3]):
            raise ValueError(
                "the camera is outside the haze, which covers only the given poses; give "
                "SceneRenderer all poses"
            )

    def _film(self, instants: int, *exposed: Any) -> Film:
        """Film of one instant, exposed or not; all instants share the samples of a sharp frame."""
        key = math.ceil(self._settings.samples_per_pixel / instants), *exposed
        if key not in self._films:
            self._films[key] = Film(self._camera, self._settings, *key)
        return self._films[key]


def _finite(radiance: NDArray[np.float32]) -> NDArray[np.float32]:
    if not np.isfinite(radiance).all():
        raise FloatingPointError(
            "the renderer returned radiance that is not finite: look for NaN in textures, "
            "spectra or vertices"
        )
    return radiance


SHARED_PX = 0.1
"""Twice what objects may be off in a line, as those that share a pose are placed at its middle."""
_STEP_S, _FEWEST_STEPS, _MOST_STEPS = 0.01, 2, 64
_RESERVE = 1.25


def lines_of_a_pose(
    meshes: Sequence[MovingMesh], camera: Camera, pose: Floats, times_s: Sequence[float]
) -> int:
    """Return the number of lines that may share a pose, for a frame with line times (L,), s.

    Lines share one if nothing visible moves by more than `SHARED_PX` between them, as a move takes
    as long as some 10⁵ light paths. All moving triangles count that are visible in the first,
    middle or last line, between moments at most `_STEP_S` apart; `_RESERVE` covers motion between
    these. A shadow moves as far as its object, in meters. The pose (4, 4) is that of the middle
    line, relative to the scene's origin.
    """
    start, end, lines = times_s[0], times_s[-1], len(times_s)
    steps = min(max(math.ceil(abs(end - start) / _STEP_S), _FEWEST_STEPS), _MOST_STEPS)
    moments = np.linspace(start, end, steps + 1)
    farthest = max(_farthest(mesh, camera, pose, moments) for mesh in meshes)
    distance_px = _RESERVE * farthest * steps
    if distance_px <= SHARED_PX:
        return lines
    most = math.floor(SHARED_PX / distance_px * max(lines - 1, 1)) + 1
    # The next of 1, 2, 3, 4, 6, 8, 12…: kernels are compiled for each number of rows.
    least = math.ceil(lines / most)
    power = 1 << (least - 1).bit_length()
    strips = power * 3 // 4 if power > 2 and power * 3 // 4 >= least else power
    return math.ceil(lines / strips)


def _farthest(mesh: MovingMesh, camera: Camera, pose: Floats, moments: Floats) -> float:
    """Longest displacement in the image, px, of a visible triangle from one moment to the next."""

    def from_camera(vertices: NDArray[np.float32]) -> Floats:
        return np.asarray(np.einsum("ji,nj->ni", pose[:3, :3], vertices - pose[:3, 3]))

    seen = np.zeros(len(mesh.faces), bool)
    for time in moments[[0, len(moments) // 2, -1]].tolist():
        seen |= _seen(mesh.faces, camera, from_camera(mesh.vertices_at(time)))
    vertex, corner = np.unique(mesh.faces[seen].astype(np.int64), return_inverse=True)
    corner = corner.reshape(-1, 3)
    places = [
        from_camera(mesh.some_vertices_at(vertex, np.full(len(vertex), time))) for time in moments
    ]
    return max(_longest(camera, a[corner], b[corner]) for a, b in pairwise(places))


def _seen(faces: NDArray[np.uint32], camera: Camera, ways: Floats) -> Mask:
    """True for triangles (F,) that may be visible in the image or the margin around it."""
    if camera.intrinsics is None:
        x, y, depth = *camera.project(ways).T, np.ones(len(ways))
    else:
        x, y, depth = np.einsum("ij,nj->in", camera.intrinsics, ways)
    margin = 0.1 * camera.width  # objects enter meanwhile
    beyond = [depth <= 0, y < -margin * depth, y > (camera.height + margin) * depth]
    if not camera.wraps:
        beyond += [x < -margin * depth, x > (camera.width + margin) * depth]
    out = np.packbits(beyond, axis=0)[0]  # for each vertex, a bit for each side
    a, b, c = faces.T
    return np.asarray(out[a] & out[b] & out[c] == 0)


def _longest(camera: Camera, before: Floats, after: Floats) -> float:
    """Longest displacement (px) from triangles (n, 3, 3) to others, by angle where one is cut."""
    places = camera.project(before)
    with np.errstate(invalid="ignore"):
        px = np.linalg.norm(camera.displacement(after, places), axis=-1).max(axis=1)
        inside = ((places >= 0) & (places <= [camera.width, camera.height])).all(axis=(1, 2))
    center = before.mean(axis=1)
    radius = np.linalg.norm(before - center[:, None], axis=-1).max(axis=1)
    near = (np.linalg.norm(center, axis=1) - radius).clip(1e-9)
    angle = np.linalg.norm(after - before, axis=-1).max(axis=1) / near
    # Most px per angle, along the image's border and its middle row and column.
    columns, rows = np.arange(camera.width + 1.0), np.arange(camera.height + 1.0)
    rims = ([0, size // 2, size] for size in camera.shape)
    lines = [np.stack([columns, np.full_like(columns, y)], axis=-1) for y in next(rims)]
    lines += [np.stack([np.full_like(rows, x), rows], axis=-1) for x in next(rims)]
    steps = [np.linalg.norm(np.diff(camera.toward(line), axis=0), axis=1) for line in lines]
    px_per_rad = float(1 / np.concatenate(steps).min().clip(1e-9))
    px = np.where(inside & np.isfinite(px), px, px_per_rad * angle)
    return float(px.max(initial=0.0))
