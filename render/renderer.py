"""Radiance and ground truth of a scene seen along a trajectory.

The scene is loaded once; per frame only the pose and the moving objects change, with a seed of its
own, since the same seed would give noise that stands still on the sensor and reads as "no motion".
"""

from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.render.geometry import Geometry
from megalopta.render.merge import MovingMesh, merge
from megalopta.render.mitsuba_scene import aim, load_scene, load_sensor, move_meshes
from megalopta.render.passes import plan_passes
from megalopta.render.settings import RenderSettings
from megalopta.render.truth import Flow, Truth, TruthTracer
from megalopta.render.variant import Variant, activate, choose_variant
from megalopta.render.views import Instant
from megalopta.scenes.camera import Camera
from megalopta.scenes.scene import Scene

# One second's work or two on a small machine, so that Ctrl-C is soon answered.
SAMPLES_PER_PASS = {"cuda": 2**24, "llvm": 2**20, "scalar": 2**19}


def trace_paths(integrator: Any, scene: Any, sensor: Any, seed: int, samples: int) -> Any:
    """Mitsuba's image, in its type.

    The integrator is called itself: `mi.render` wraps it for differentiation, and that wrapper
    turns Ctrl-C into a RuntimeError.
    """
    return integrator.render(scene, sensor, seed=seed, spp=samples)


class SceneRenderer:
    """A loaded scene and a camera, ready to be moved along poses.

    Parameters
    ----------
    scene : Scene
        What to render.
    camera : Camera
        Projection, image size and field of view.
    settings : RenderSettings
        Samples, bands, backend.

    Attributes
    ----------
    samples_per_pixel : int
        Light paths per pixel as the sampler rounds them.
    variant : Variant
        The Mitsuba variant in use.
    """

    def __init__(self, scene: Scene, camera: Camera, settings: RenderSettings) -> None:
        self.camera = camera
        self.settings = settings
        self.variant: Variant = choose_variant(settings.backend)
        activate(self.variant)
        family = self.variant.name.partition("_")[0]
        most = settings.samples_per_pass or SAMPLES_PER_PASS[family]
        self._passes = plan_passes(camera.width, camera.height, settings.samples_per_pixel, most)
        self._sensor = load_sensor(
            camera, settings.bands_nm, settings.sampler, self._passes.samples, self._passes.rows
        )
        self._samples = int(self._sensor.sampler().sample_count())
        self.samples_per_pixel = self._samples * self._passes.repeats
        meshes = merge(scene)
        self._scene = load_scene(scene, meshes)
        self._moving = {
            index: mesh for index, mesh in enumerate(meshes) if isinstance(mesh, MovingMesh)
        }
        self._time_s = 0.0
        self._origin = np.asarray(scene.origin_m)
        self._tracer = TruthTracer(scene, Geometry(meshes, self._scene), camera)
        self._sensor_parameters = mi.traverse(self._sensor)
        self._integrator = mi.load_dict({"type": "path", "max_depth": settings.max_depth})

    def radiance(
        self, pose: NDArray[np.float64], seed: int, time_s: float = 0.0
    ) -> NDArray[np.float32]:
        """Spectral radiance (H, W, B) seen from a pose (4, 4), W·m⁻²·sr⁻¹·nm⁻¹, band means.

        Parameters
        ----------
        pose : (4, 4) array
            Camera to world.
        seed : int
            Of the noise.
        time_s : float
            Where the moving objects are; of no account in a scene at rest.

        Raises
        ------
        FloatingPointError
            When the renderer returns a value that is not finite.
        """
        self._move_to(time_s)
        local = self._local(pose)

        def trace(first_row: int, pass_seed: int) -> NDArray[np.float32]:
            aim(self._sensor_parameters, self.camera, local, first_row, self._passes.rows)
            image = trace_paths(
                self._integrator, self._scene, self._sensor, pass_seed, self._samples
            )
            return np.array(image, dtype=np.float32)

        radiance = self._passes.render(trace, seed).astype(np.float32)
        if not np.isfinite(radiance).all():
            raise FloatingPointError(
                "the renderer returned radiance that is not finite: look for NaN in textures, "
                "spectra or vertices"
            )
        return radiance

    def truth(
        self, poses: NDArray[np.float64], frame: int, times_s: ArrayLike | None = None
    ) -> Truth:
        """Ground truth of one frame of a sequence.

        Parameters
        ----------
        poses : (T, 4, 4) array
            Camera to world, of all frames.
        frame : int
            Which one; flow is toward the one after and the one before.
        times_s : (T,) array_like, optional
            Time of each frame, s; needed where objects move.
        """
        last = len(poses) - 1
        return self._tracer.truth(
            self._view(poses, frame, times_s),
            self._view(poses, frame + 1, times_s) if frame < last else None,
            self._view(poses, frame - 1, times_s) if frame > 0 else None,
        )

    def flow(
        self, poses: NDArray[np.float64], frame: int, other: int, times_s: ArrayLike | None = None
    ) -> Flow:
        """Flow and occlusion from one frame to any other of a sequence; arguments as of `truth`."""
        return self._tracer.flow(
            self._view(poses, frame, times_s), self._view(poses, other, times_s)
        )

    def _view(self, poses: NDArray[np.float64], frame: int, times_s: ArrayLike | None) -> Instant:
        if times_s is None and self._moving:
            raise ValueError("times_s is missing: objects move in this scene; give the times")
        time = 0.0 if times_s is None else float(np.asarray(times_s)[frame])
        return Instant(time, self._local(poses[frame]))

    def _local(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The pose relative to the scene's origin, in the renderer's precision."""
        local = pose.copy()
        local[:3, 3] = (pose[:3, 3] - self._origin).astype(np.float32)
        return local

    def _move_to(self, time_s: float) -> None:
        if time_s == self._time_s or not self._moving:
            return
        normals = {index: mesh.normals_at(time_s) for index, mesh in self._moving.items()}
        move_meshes(
            self._scene,
            {index: mesh.vertices_at(time_s) for index, mesh in self._moving.items()},
            {index: each for index, each in normals.items() if each is not None},
        )
        self._time_s = time_s
