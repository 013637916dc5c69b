"""Radiance and ground truth of a scene seen along a trajectory.

The scene is loaded once; per frame only the pose moves, with a seed of its own, since the same seed
would give noise that stands still on the sensor and reads as "no motion".
"""

from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from megalopta.render.merge import merge
from megalopta.render.mitsuba_scene import aim, load_scene, load_sensor
from megalopta.render.passes import plan_passes
from megalopta.render.settings import RenderSettings
from megalopta.render.truth import TriangleTable, Truth, frame_truth
from megalopta.render.variant import Variant, activate, choose_variant
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
        self._table = TriangleTable.of(meshes)
        self._sensor_parameters = mi.traverse(self._sensor)
        self._integrator = mi.load_dict({"type": "path", "max_depth": settings.max_depth})

    def radiance(self, pose: NDArray[np.float64], seed: int) -> NDArray[np.float32]:
        """Spectral radiance (H, W, B) seen from a pose (4, 4), W·m⁻²·sr⁻¹·nm⁻¹, band means.

        Raises
        ------
        FloatingPointError
            When the renderer returns a value that is not finite.
        """

        def trace(first_row: int, pass_seed: int) -> NDArray[np.float32]:
            aim(self._sensor_parameters, self.camera, pose, first_row, self._passes.rows)
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

    def truth(self, poses: NDArray[np.float64], frame: int) -> Truth:
        """Ground truth of one frame of a sequence of poses (T, 4, 4)."""
        return frame_truth(
            self._scene,
            self._table,
            self.camera,
            poses[frame],
            poses[frame + 1] if frame + 1 < len(poses) else None,
            poses[frame - 1] if frame > 0 else None,
        )
