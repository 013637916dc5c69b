"""A camera's film: takes frames in passes, from one pose or row by row from many."""

from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from megalopta.render import RenderSettings
from megalopta.render.loading import aim, load_rows_sensor, load_sensor, sensor_transform_matrix
from megalopta.render.passes import plan_passes
from megalopta.scenes.cameras import Camera

Float64 = NDArray[np.float64]

# A second's work or less on a small machine, so that Ctrl-C is soon answered.
SAMPLES_PER_PASS = {"cuda": 2**24, "llvm": 2**20, "scalar": 2**19}


def trace_paths(integrator: Any, scene: Any, sensor: Any, seed: int, samples: int) -> Any:
    """Mitsuba's image, in its type.

    The integrator is called itself: `mi.render` wraps it for differentiation, and that wrapper
    turns Ctrl-C into a RuntimeError.
    """
    return integrator.render(scene, sensor, seed=seed, spp=samples)


class Film:
    """What a sensor of Mitsuba's and the division of frames into passes make together.

    Parameters
    ----------
    camera : Camera
        Projection, image size and field of view.
    settings : RenderSettings
        Bands and sampler.
    samples : int
        Light paths per pixel.
    has_row_poses : bool
        Whether every row has a pose of its own.

    Attributes
    ----------
    samples_per_pixel : int
        Light paths per pixel as the sampler rounds them.
    """

    def __init__(
        self, camera: Camera, settings: RenderSettings, samples: int, has_row_poses: bool = False
    ) -> None:
        family = str(mi.variant()).partition("_")[0]
        most = settings.samples_per_pass or SAMPLES_PER_PASS[family]
        self._camera = camera
        self._passes = plan_passes(camera.width, camera.height, samples, most)
        arguments = (
            camera, settings.bands_nm, settings.sampler, self._passes.samples, self._passes.rows
        )  # fmt: skip
        self._optics = self._sensor = load_sensor(*arguments)
        if has_row_poses:
            self._sensor = load_rows_sensor(*arguments, self._optics)
        self._parameters = mi.traverse(self._optics)
        self._samples = int(self._sensor.sampler().sample_count())
        self.samples_per_pixel = self._samples * self._passes.repeats

    def expose(self, integrator: Any, scene: Any, pose: Float64, seed: int) -> NDArray[np.float32]:
        """Take a frame (H, W, B) from a pose (4, 4), or from one for each row (H, 4, 4)."""

        def trace(first_row: int, pass_seed: int) -> NDArray[np.float32]:
            self._aim(pose, first_row)
            image = trace_paths(integrator, scene, self._sensor, pass_seed, self._samples)
            return np.array(image, dtype=np.float32)

        return self._passes.render(trace, seed).astype(np.float32)

    def _aim(self, pose: Float64, first_row: int) -> None:
        rows = self._passes.rows
        if self._sensor is self._optics:
            aim(self._parameters, self._camera, pose, first_row, rows)
            return
        identity = sensor_transform_matrix(np.eye(4))  # of Mitsuba's camera axes
        aim(self._parameters, self._camera, identity, first_row, rows)
        # The last strip may reach beyond the frame.
        strip = np.minimum(np.arange(first_row, first_row + rows), self._camera.height - 1)
        self._sensor.move(sensor_transform_matrix(pose[strip]))
