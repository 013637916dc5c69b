"""Surfaces seen by a camera: light paths from its pixels, with objects that may move.

The truncation bias is the light that frames miss because it takes more hits than their paths may
have. Paths of equal seeds start alike, so few longer ones are enough to measure it.
"""

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render.baking.integrator import BakedLightIntegrator
from megalopta.render.loading.air import Air
from megalopta.render.loading.meshes import MovingMesh
from megalopta.render.loading.scene import LoadedScene, move_to
from megalopta.render.noise import MeasuredPass
from megalopta.render.path_tracing import PathIntegrator
from megalopta.render.sensors.film import Exposure, Film
from megalopta.render.settings import RenderSettings
from megalopta.render.sharing import rows_of_a_pose
from megalopta.render.split_paths import SplitPaths
from megalopta.render.surveys import LightMeter, LightSurvey
from megalopta.scenes.cameras.base import Camera

Integrator: TypeAlias = PathIntegrator | SplitPaths | BakedLightIntegrator

_MORE_HITS = 32
"""Leaves at 0.8 to 1.3 µm are the brightest surfaces: for these, 16 hits miss a thousandth."""
_LONGER_SEED = 0


def share_left_out(
    scene: Any, film: Film, pose: Floats, max_depth: int, air: Air | None = None
) -> Floats:
    """Return the share of the light of surfaces, by band, that more hits would add, (B,).

    Parameters
    ----------
    scene
        Loaded scene.
    film
        Film with few samples.
    pose : (4, 4)
    max_depth : int
        Longest path of the frames.
    air
        The scene's haze.
    """
    short, long = (PathIntegrator(depth, air) for depth in (max_depth, max_depth + _MORE_HITS))
    found = film.expose(short.render, scene, pose, _LONGER_SEED)
    whole = film.expose(long.measured, scene, pose, _LONGER_SEED)
    bands, shows_surfaces = found.shape[-1], whole[..., -1] == 0
    part, all_of_it = (
        each[shows_surfaces, :bands].sum(axis=0, dtype=np.float64) for each in (found, whole)
    )
    kept = np.divide(part, all_of_it, out=np.ones(bands), where=all_of_it > 0)
    return np.asarray(1 - kept)


_LONGER_PATHS = 2**15
"""Number of longer paths for the truncation bias; at least one per pixel"""


class SurfaceView:
    """Camera in a loaded scene, with the integrator that finds its light."""

    def __init__(
        self,
        whole: LoadedScene,
        camera: Camera,
        settings: RenderSettings,
        integrator: Integrator,
        air: Air | None = None,
    ) -> None:
        self._scene, self._loaded, self._integrator = whole.scene, whole.loaded, integrator
        self._camera, self._settings, self._air = camera, settings, air
        self._moving = {
            index: mesh for index, mesh in enumerate(whole.meshes) if isinstance(mesh, MovingMesh)
        }
        self._time_s = 0.0
        self._films: dict[tuple[int, bool, int | None], Film] = {}

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

    def radiance(self, exposure: Exposure) -> NDArray[np.float32]:
        """Radiance (H, W, B) of an exposure.

        Raises FloatingPointError if Mitsuba returns a value that is not finite, and ValueError if a
        pose is outside the haze.
        """
        return _finite(self._taken(exposure, is_measured=False))

    def measured(self, exposure: Exposure) -> MeasuredPass:
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
        wanted = math.ceil(_LONGER_PATHS / (self._camera.width * self._camera.height))
        samples = min(wanted, self._settings.samples_per_pixel)
        self._check(pose)
        # The other's sampler serves light: the path tracer is compiled for each.
        settings = self._settings.model_copy(update={"sampler": "independent"})
        film = Film(self._camera, settings, samples)
        return share_left_out(self._loaded, film, pose, self._settings.max_depth, self._air)

    def _taken(self, exposure: Exposure, is_measured: bool) -> NDArray[np.float32]:
        """Mean over the instants at which moving objects are placed; the camera moves continuously.

        Rows of a rolling shutter share poses of moving objects (`sharing`).
        """
        integrator = self._integrator if exposure.is_instant else self._integrator.exposing
        trace = integrator.measured if is_measured else integrator.render
        move_to = self.move_to if integrator is self._integrator else integrator.move_to
        rows = None
        if self._moving and exposure.is_rolling:
            part = exposure.parts[len(exposure.parts) // 2]
            count, height = part.poses.shape[:2]
            pose, meshes = part.poses[count // 2, height // 2], list(self._moving.values())
            rows = rows_of_a_pose(meshes, self._camera, pose, part.row_times_s)
        film = self._film(len(exposure.parts), not exposure.is_instant, rows)
        images = []
        for part in exposure.parts:
            self._check(part.poses)

            def move(strip: slice, times: Sequence[float] = part.row_times_s) -> None:
                move_to(float(np.mean(times[strip])))

            if rows is None:
                move_to(part.row_times_s[0])
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

    def _film(self, instants: int, is_exposed: bool = False, most_rows: int | None = None) -> Film:
        """Film of one instant; all instants share the samples of a sharp frame."""
        samples = math.ceil(self._settings.samples_per_pixel / instants)
        key = samples, is_exposed, most_rows
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
