"""Film of a camera: frames in passes, at an instant or over an exposure.

Passes are strips of rows and, if one row is too much, repeats of it. A running kernel cannot be
interrupted, holds its whole strip in memory and numbers its samples with 32 bits; so passes are
short. Strips come first because they keep each pixel's stratified samples together: 64 at once are
a fifth less noisy than four times 16. A shutter that reads columns has a film on its side.

A channel is the integral of radiance against a box of height 1/width, that is, the band mean in
W·m⁻²·sr⁻¹·nm⁻¹.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render import Bands, RenderSettings, mi
from megalopta.render.mitsuba_loader import registered
from megalopta.render.sensors.optics import Rows, cut_strip, plugin, sensor_transform
from megalopta.render.settings import part_seed
from megalopta.scenes.cameras.base import Camera

TraceStrip = Callable[[int, int], NDArray[np.floating]]
"""Function that renders the strip (rows, W, B) from a given row on, with a given seed."""


@dataclass(frozen=True)
class Passes:
    """Division of a frame into passes."""

    height: int
    """Rows of the frame."""
    rows: int
    """Rows of a strip; the last one may extend beyond the frame."""
    samples: int
    """Light paths per pixel and pass."""
    repeats: int
    """Number of passes over each strip."""

    def render(self, trace: TraceStrip, seed: int) -> Floats:
        """Assemble a frame (H, W, B); the first pass has its seed, others derive theirs."""
        strips = [
            sum(
                trace(first, pass_seed(seed, number * self.repeats + repeat)).astype(np.float64)
                for repeat in range(self.repeats)
            )
            / self.repeats
            for number, first in enumerate(range(0, self.height, self.rows))
        ]
        return np.concatenate(strips)[: self.height]


def plan_passes(width: int, height: int, samples: int, most: int) -> Passes:
    """Divide a frame into the fewest passes of at most `most` samples each.

    A pass has at least one sample of every pixel of a row.
    """
    strips = math.ceil(height / max(most // (width * samples), 1))
    repeats = math.ceil(samples / max(most // width, 1))
    return Passes(height, math.ceil(height / strips), math.ceil(samples / repeats), repeats)


def pass_seed(seed: int, number: int) -> int:
    """32-bit Mitsuba seed of one pass of a frame; the first keeps the frame's."""
    return part_seed(seed, "pass", number) if number else seed


Trace = Callable[..., NDArray[np.float32]]
"""`render` or `measured` of an integrator: image (H, W, n) of a scene, sensor, seed and samples per
pixel."""

# At most a second's work on a small machine, so that Ctrl-C acts soon.
SAMPLES_PER_PASS = {"cuda": 2**24, "llvm": 2**20, "scalar": 2**19}


@dataclass(frozen=True)
class ExposurePart:
    """Part of an exposure, in which moving objects are at rest."""

    poses: Floats
    """(K, L, 4, 4): camera to world at K times, for all lines (L = 1) or for each (L = H, or W of
    columns); (4, 4) for an instant."""
    line_times_s: list[float]
    """(L,): times in the middle of the part."""
    seed: int


@dataclass(frozen=True)
class FrameExposure:
    """Poses and times of a frame's exposure."""

    parts: tuple[ExposurePart, ...]
    is_rolling: bool = False
    by_columns: bool = False
    """True if columns are read one after the other, not rows."""

    @property
    def is_instant(self) -> bool:
        """True for an instant, with a single pose."""
        return self.parts[0].poses.ndim == 2


class Film:
    """Mitsuba sensor with the division of frames into passes.

    An exposed film takes the samples of a pixel from many poses. No pass has more than `most_rows`.
    The rows of one `on_side` are the camera's columns. `samples_per_pixel` is the requested number,
    as rounded by the sampler.
    """

    def __init__(
        self,
        camera: Camera,
        settings: RenderSettings,
        samples: int,
        is_exposed: bool = False,
        most_rows: int | None = None,
        on_side: bool = False,
    ) -> None:
        family = str(mi.variant()).partition("_")[0]
        most = settings.samples_per_pass or SAMPLES_PER_PASS[family]
        height, width = camera.shape[::-1] if on_side else camera.shape
        if most_rows:
            most = min(most, width * samples * most_rows)
        self._on_side = on_side
        self._passes = passes = plan_passes(width, height, samples, most)
        size = width, passes.rows
        parts = film_and_sampler(size, settings.bands_nm, settings.sampler, passes.samples)
        self._optics = self._sensor = mi.load_dict({**plugin(camera, on_side), **parts})
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
        poses: Floats,
        seed: int,
        before_rows: Callable[[slice], None] | None = None,
    ) -> NDArray[np.float32]:
        """Take a frame (H, W, n) from a pose (4, 4), or exposed from poses (times, lines, 4, 4).

        These have one line for all, or each. `before_rows` is called with the rows of each pass.
        """

        def take(first_row: int, pass_seed: int) -> NDArray[np.float32]:
            if before_rows:
                before_rows(slice(first_row, first_row + self._passes.rows))
            self._aim(poses, first_row)
            return trace(scene, self._sensor, seed=pass_seed, spp=self._samples)

        image = self._passes.render(take, seed).astype(np.float32)
        return np.ascontiguousarray(image.swapaxes(0, 1)) if self._on_side else image

    def _aim(self, poses: Floats, first_row: int) -> None:
        rows, is_exposed = self._passes.rows, poses.ndim > 2
        # An exposed film looks through optics at Mitsuba's identity.
        to_world = np.eye(4) if is_exposed else sensor_transform(poses)
        self._parameters["to_world"] = mi.Transform4f(to_world.tolist())
        cut_strip(self._parameters, self._passes.height, first_row, rows)
        self._parameters.update()
        if is_exposed:
            # The last strip may extend beyond the frame.
            strip = np.minimum(np.arange(first_row, first_row + rows), poses.shape[1] - 1)
            self._sensor.move(sensor_transform(poses[:, strip] if poses.shape[1] > 1 else poses))


def film_and_sampler(
    size: tuple[int, int], bands_nm: Bands, sampler: str, samples: int
) -> dict[str, Any]:
    """Mitsuba film, of a width and height in px, and sampler."""
    film: dict[str, Any] = {
        "type": "specfilm",
        "width": size[0],
        "height": size[1],
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
