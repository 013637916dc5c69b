"""Radiance and ground truth of a scene seen along a trajectory.

The scene is loaded once; per frame only the pose moves, with a seed of its own, since the same seed
would give noise that stands still on the sensor and reads as "no motion".
"""

from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from megalopta.render.baked import BakedRenderer, path_tracing_reason
from megalopta.render.merge import merge
from megalopta.render.mitsuba_scene import load_scene, load_sensor, sensor_transform
from megalopta.render.settings import RenderSettings, bake_seed, check_sample_count
from megalopta.render.truth import TriangleTable, Truth, frame_truth
from megalopta.render.variant import Variant, activate, choose_variant
from megalopta.scenes.camera import PerspectiveCamera
from megalopta.scenes.scene import Scene


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
    camera : PerspectiveCamera
        Image size and field of view.
    settings : RenderSettings
        Samples, bands, backend.
    poses : (T, 4, 4) float64, optional
        Where the camera will come; light is baked for these. Without them paths are traced.
    seed : int
        Seed of the sequence, for what its frames share.

    Attributes
    ----------
    samples_per_pixel : int
        Light paths per pixel as the sampler rounds them.
    variant : Variant
        The Mitsuba variant in use.
    integrator : str
        "baked" or "path", and why paths are traced.

    Raises
    ------
    ValueError
        When a frame has more samples than one pass can number.
    """

    def __init__(
        self,
        scene: Scene,
        camera: PerspectiveCamera,
        settings: RenderSettings,
        poses: NDArray[np.float64] | None = None,
        seed: int = 0,
    ) -> None:
        check_sample_count(camera, settings)
        self.camera = camera
        self.settings = settings
        self.variant: Variant = choose_variant(settings.backend)
        activate(self.variant)
        self._sensor = load_sensor(
            camera, settings.bands_nm, settings.sampler, settings.samples_per_pixel
        )
        self.samples_per_pixel = int(self._sensor.sampler().sample_count())
        check_sample_count(camera, settings, self.samples_per_pixel)
        meshes = merge(scene)
        self._scene = load_scene(scene, meshes)
        self._table = TriangleTable.of(meshes)
        self._sensor_parameters = mi.traverse(self._sensor)
        self._integrator = mi.load_dict({"type": "path", "max_depth": settings.max_depth})
        reason = path_tracing_reason(scene, self.variant.name, poses, settings)
        self.integrator = f"path ({reason})" if reason else "baked"
        self._baked: BakedRenderer | None = None
        if poses is not None and not reason:
            self._baked = BakedRenderer(
                self._scene, scene, meshes, settings, camera, poses, bake_seed(seed)
            )

    def radiance(self, pose: NDArray[np.float64], seed: int) -> NDArray[np.float32]:
        """Spectral radiance (H, W, B) seen from a pose (4, 4), W·m⁻²·sr⁻¹·nm⁻¹, band means.

        Raises
        ------
        FloatingPointError
            When the renderer returns a value that is not finite.
        """
        self._sensor_parameters["to_world"] = sensor_transform(pose)
        self._sensor_parameters.update()
        if self._baked:
            radiance = self._baked.radiance(self._sensor, seed)
        else:
            image = trace_paths(
                self._integrator, self._scene, self._sensor, seed, self.samples_per_pixel
            )
            radiance = np.array(image, dtype=np.float32)
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
