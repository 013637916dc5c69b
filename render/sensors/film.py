"""A camera's film: takes frames in passes, from one pose or row by row from many.

A channel is the integral of radiance against a box of height 1/width, so that it reads the band
mean in W·m⁻²·sr⁻¹·nm⁻¹.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import Bands, RenderSettings, mi
from megalopta.render.sensors.optics import cut_strip, plugin, sensor_transform
from megalopta.render.sensors.passes import plan_passes
from megalopta.render.sensors.rows import ROWS, register_rows
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

    Its `samples_per_pixel` are those asked for as the sampler rounds them.
    """

    def __init__(
        self, camera: Camera, settings: RenderSettings, samples: int, has_row_poses: bool = False
    ) -> None:
        family = str(mi.variant()).partition("_")[0]
        most = settings.samples_per_pass or SAMPLES_PER_PASS[family]
        self._camera = camera
        self._passes = plan_passes(camera.width, camera.height, samples, most)
        parts = _film_and_sampler(
            camera, settings.bands_nm, settings.sampler, self._passes.samples, self._passes.rows
        )
        self._optics = self._sensor = mi.load_dict({**plugin(camera), **parts})
        if has_row_poses:
            register_rows(mi.variant())
            self._sensor = mi.load_dict({"type": ROWS, **parts})
            self._sensor.optics = self._optics
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
        # Rows with poses of their own look through optics at Mitsuba's identity.
        to_world = np.eye(4) if pose.ndim == 3 else sensor_transform(pose)
        self._parameters["to_world"] = mi.Transform4f(to_world.tolist())
        cut_strip(self._camera, self._parameters, first_row, rows)
        self._parameters.update()
        if pose.ndim == 3:
            # The last strip may reach beyond the frame.
            strip = np.minimum(np.arange(first_row, first_row + rows), self._camera.height - 1)
            self._sensor.move(sensor_transform(pose[strip]))


def _film_and_sampler(
    camera: Camera, bands_nm: Bands, sampler: str, samples: int, rows: int
) -> dict[str, Any]:
    film: dict[str, Any] = {
        "type": "specfilm",
        "width": camera.width,
        "height": rows,
        "component_format": "float32",
        # The only filter that is bit-reproducible in vectorized variants, and a pixel is a box.
        "rfilter": {"type": "box"},
    }
    for index, (lower, upper) in enumerate(bands_nm):
        film[f"band_{index:03d}"] = {
            "type": "regular",
            "wavelength_min": lower,
            "wavelength_max": upper,
            "values": ",".join([repr(1 / (upper - lower))] * 2),
        }
    return {"film": film, "sampler": {"type": sampler, "sample_count": samples}}
