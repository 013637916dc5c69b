"""A camera's film: takes frames in passes, at an instant or over a time of exposure.

A channel is the integral of radiance against a box of height 1/width, so that it reads the band
mean in W·m⁻²·sr⁻¹·nm⁻¹.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import Bands, RenderSettings, mi
from megalopta.render.mitsuba_loader import registered
from megalopta.render.sensors.optics import cut_strip, plugin, sensor_transform
from megalopta.render.sensors.passes import plan_passes
from megalopta.render.sensors.plug_ins import Rows
from megalopta.scenes.cameras.base import Camera

Float64 = NDArray[np.float64]
Trace = Callable[..., NDArray[np.float32]]
"""`render` or `measured` of an integrator: an image (H, W, n) of a scene, a sensor, a seed and the
samples per pixel."""

# A second's work or less on a small machine, so that Ctrl-C is soon answered.
SAMPLES_PER_PASS = {"cuda": 2**24, "llvm": 2**20, "scalar": 2**19}


class Film:
    """What a sensor of Mitsuba's and the division of frames into passes make together.

    An exposed film takes the samples of a pixel from many poses. No pass has more than `most_rows`.
    Its `samples_per_pixel` are those asked for as the sampler rounds them.
    """

    def __init__(
        self,
        camera: Camera,
        settings: RenderSettings,
        samples: int,
        is_exposed: bool = False,
        most_rows: int | None = None,
    ) -> None:
        family = str(mi.variant()).partition("_")[0]
        most = settings.samples_per_pass or SAMPLES_PER_PASS[family]
        if most_rows:
            most = min(most, camera.width * samples * most_rows)
        self._camera = camera
        self._passes = plan_passes(camera.width, camera.height, samples, most)
        parts = _film_and_sampler(
            camera, settings.bands_nm, settings.sampler, self._passes.samples, self._passes.rows
        )
        self._optics = self._sensor = mi.load_dict({**plugin(camera), **parts})
        if is_exposed:
            shutter = {"shutter_open": 0.0, "shutter_close": 1.0}
            self._sensor = mi.load_dict({"type": registered(Rows), **shutter, **parts})
            self._sensor.optics = self._optics
        self._parameters = mi.traverse(self._optics)
        self._samples = int(self._sensor.sampler().sample_count())
        self.samples_per_pixel = self._samples * self._passes.repeats

    def expose(
        self,
        trace: Trace,
        scene: Any,
        poses: Float64,
        seed: int,
        before_rows: Callable[[slice], None] | None = None,
    ) -> NDArray[np.float32]:
        """Take a frame (H, W, n) from a pose (4, 4), or exposed from poses (times, rows, 4, 4).

        These have one row for all, or H. `before_rows` is called with those of each pass.
        """

        def take(first_row: int, pass_seed: int) -> NDArray[np.float32]:
            if before_rows:
                before_rows(slice(first_row, first_row + self._passes.rows))
            self._aim(poses, first_row)
            return trace(scene, self._sensor, seed=pass_seed, spp=self._samples)

        return self._passes.render(take, seed).astype(np.float32)

    def _aim(self, poses: Float64, first_row: int) -> None:
        rows, is_exposed = self._passes.rows, poses.ndim > 2
        # What is exposed looks through optics at Mitsuba's identity.
        to_world = np.eye(4) if is_exposed else sensor_transform(poses)
        self._parameters["to_world"] = mi.Transform4f(to_world.tolist())
        cut_strip(self._camera, self._parameters, first_row, rows)
        self._parameters.update()
        if is_exposed:
            # The last strip may reach beyond the frame.
            strip = np.minimum(np.arange(first_row, first_row + rows), poses.shape[1] - 1)
            self._sensor.move(sensor_transform(poses[:, strip] if poses.shape[1] > 1 else poses))


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
