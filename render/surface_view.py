"""Surfaces seen by a camera: light paths from its pixels, over objects that may move."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render.illuminance import LightMeter, LightSurvey
from megalopta.render.loading import MergedMesh, MovingMesh, move_meshes
from megalopta.render.sensors import Film
from megalopta.render.settings import RenderSettings
from megalopta.scenes.cameras import Camera
from megalopta.scenes.world import Scene


class SurfaceView:
    """A camera in a loaded scene, and Mitsuba's integrator that follows its paths."""

    def __init__(
        self,
        scene: Scene,
        meshes: Sequence[MergedMesh],
        loaded: Any,
        camera: Camera,
        settings: RenderSettings,
        integrator: Any,
    ) -> None:
        self._scene, self._loaded, self._integrator = scene, loaded, integrator
        self._camera, self._settings = camera, settings
        self._moving = {
            index: mesh for index, mesh in enumerate(meshes) if isinstance(mesh, MovingMesh)
        }
        self._time_s = 0.0
        self._films: dict[tuple[int, bool], Film] = {}

    @property
    def samples_per_pixel(self) -> int:
        """Light paths per pixel as the sampler rounds them."""
        return self._film(1, False).samples_per_pixel

    def move_to(self, time_s: float) -> None:
        """Put moving objects where they are at a time."""
        if time_s == self._time_s or not self._moving:
            return
        normals = {index: mesh.normals_at(time_s) for index, mesh in self._moving.items()}
        move_meshes(
            self._loaded,
            {index: mesh.vertices_at(time_s) for index, mesh in self._moving.items()},
            {index: each for index, each in normals.items() if each is not None},
        )
        self._time_s = time_s

    def radiance(
        self, pose: NDArray[np.float64], seed: int, instants: int = 1
    ) -> NDArray[np.float32]:
        """Radiance (H, W, B) from a pose, or one for each row, at one of the instants of a frame.

        Raises FloatingPointError when Mitsuba returns a value that is not finite.
        """
        film = self._film(instants, pose.ndim == 3)
        radiance = film.expose(self._integrator, self._loaded, pose, seed)
        if not np.isfinite(radiance).all():
            raise FloatingPointError(
                "the renderer returned radiance that is not finite: look for NaN in textures, "
                "spectra or vertices"
            )
        return radiance

    def light_survey(self, positions: NDArray[np.float64]) -> LightSurvey | None:
        """Illuminance above and below positions (N, 3); None where only surfaces emit."""
        lighting = self._scene.lighting
        if lighting is None:
            return None
        meter = LightMeter(self._loaded, lighting.sun, self._settings.max_depth)
        return meter.survey(positions - self._scene.origin_m)

    def _film(self, instants: int, has_row_poses: bool) -> Film:
        """The film of one instant; all instants share the samples of a sharp frame."""
        key = math.ceil(self._settings.samples_per_pixel / instants), has_row_poses
        if key not in self._films:
            self._films[key] = Film(self._camera, self._settings, *key)
        return self._films[key]
