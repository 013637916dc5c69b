"""What levels of detail and baked light gain on a forest of 1000 trees, and what they change.

A sequence in which the camera walks and looks once around is rendered in three ways:

- full: every plant in full, every path traced: the reference;
- levels: levels of detail, every path traced;
- default: levels of detail, and the integrator that `auto` chooses: light is baked once.

The required threefold speed is that of `default` over `full`, whole sequences compared: growing and
loading the forest, the look at the sequence, baking and frames, in CPU-seconds. A traced sequence
costs its frames alike, and is foreseen from a few of them; the default one is rendered in full.
Levels of detail alone gain little, since a ray costs nearly as much in few triangles as in many
(`levels` over `full`, frames alone).

Statistics of the image are free of Monte Carlo noise that changes from frame to frame: powers are
cross powers of two renderings with independent noise. The noise of baked light stands still, and
counts as part of the image. Takes 8 CPU-minutes and 10 GB.
"""

import time
from dataclasses import dataclass, field

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene

CAMERA = PerspectiveCamera(width=251, height=251, fov_deg=100)
WALK = Trajectory(frames=100, frame_rate_hz=10, rotation_deg_s=36, velocity_m_s=(0.15, 0.05, 0.0))
VIEWS = range(5, WALK.frames, 16)
"""Frames whose images are compared."""
SETTINGS = RenderSettings(samples_per_pixel=16, max_depth=4, bands_nm=((500, 600),))
OCTAVES = (1, 2, 4, 8, 16, 32, 64, 125)
"""Limits of the bands of the power spectrum (cycles per image)."""
REQUIRED = 3.0


@dataclass
class Way:
    """A way to render the sequence, and the CPU-seconds that it took."""

    name: str
    renderer: SceneRenderer
    once_s: float
    frames_s: list[float] = field(default_factory=list)

    def frame(self, index: int, noise: int) -> NDArray[np.float32]:
        start = time.process_time()
        image = self.renderer.radiance(WALK.poses()[index], 1000 * noise + index)[..., 0]
        self.frames_s.append(time.process_time() - start)
        return image


def loaded(name: str, detail: float, integrator: str) -> Way:
    start = time.process_time()
    scene = build_scene(Forest(trees=1000, detail=detail), Light(), CAMERA, WALK)
    settings = SETTINGS.model_copy(update={"integrator": integrator})
    renderer = SceneRenderer(scene, CAMERA, settings, WALK.poses())
    seconds = time.process_time() - start
    print(
        f"{name}: {scene.triangle_count:,} triangles, integrator {renderer.integrator}; "
        f"grown and loaded in {seconds:.1f} CPU-s",
        flush=True,
    )
    return Way(name, renderer, seconds)


def compared(ways: list[Way]) -> NDArray[np.float64]:
    """Images (way, half, view, H, W), view by view in turn."""
    images = np.empty((len(ways), 2, len(VIEWS), CAMERA.height, CAMERA.width))
    for half, view in np.ndindex(2, len(VIEWS)):
        for index, way in enumerate(ways):
            images[index, half, view] = way.frame(VIEWS[view], half + 1)
    return images


def statistics(halves: NDArray[np.float64]) -> tuple[float, float, NDArray[np.float64]]:
    """Mean radiance, contrast σ/mean and power per octave over mean², of all views (2, V, H, W)."""
    mean = halves.mean()
    window = np.outer(np.hanning(CAMERA.height), np.hanning(CAMERA.width))
    first, second = halves - halves.mean(axis=(2, 3), keepdims=True)
    contrast = np.sqrt((first * second).mean()) / mean
    cross = np.real(np.fft.fft2(first * window) * np.fft.fft2(second * window).conj())
    cycles = np.hypot(
        np.fft.fftfreq(CAMERA.height, 1 / CAMERA.height)[:, None],
        np.fft.fftfreq(CAMERA.width, 1 / CAMERA.width),
    )
    octave = np.digitize(cycles, OCTAVES)
    power = [cross[:, octave == n].sum() / mean**2 for n in range(1, len(OCTAVES))]
    return float(mean), float(contrast), np.array(power)


def main() -> None:
    default = loaded("default", 1.0, "auto")
    for index in range(WALK.frames):
        default.frame(index, 0)
    default_s = default.once_s + np.cumsum(default.frames_s)
    traced = [loaded("levels", 1.0, "path"), loaded("full", 1000.0, "path")]
    for way in traced:
        way.frame(0, 0)  # compiles kernels
        way.frames_s.clear()
    images = compared([default, *traced])
    levels_s, full_s = (float(np.mean(way.frames_s)) for way in traced)
    reference_s = traced[1].once_s + full_s * np.arange(1, WALK.frames + 1)
    gain = reference_s / default_s
    reached = np.flatnonzero(gain >= REQUIRED)
    samples = CAMERA.width * CAMERA.height * SETTINGS.samples_per_pixel / 1e6
    print(
        f"{mi.variant()}, {CAMERA.width} px, {SETTINGS.samples_per_pixel} samples, "
        f"{WALK.frames} frames; million samples per CPU-second:\n"
        f"  default over full, all included  {samples * WALK.frames / default_s[-1]:.3f} and "
        f"{samples * WALK.frames / reference_s[-1]:.3f}: {gain[-1]:.2f} times (required: "
        f"{REQUIRED:g}), from frame {reached[0] + 1 if len(reached) else 'none'} on at least "
        f"{REQUIRED:g}\n"
        f"  levels over full, frames alone   {samples / levels_s:.3f} and {samples / full_s:.3f}: "
        f"{full_s / levels_s:.2f} times"
    )
    *others, full = (statistics(halves) for halves in images)
    for way, found in zip((default, traced[0]), others, strict=True):
        print(
            f"  {way.name} over full (required: within 2 %): mean radiance "
            f"{found[0] / full[0]:.4f}, contrast {found[1] / full[1]:.4f},\n"
            f"    power {found[2].sum() / full[2].sum():.4f}, by octave "
            f"{np.round(found[2] / full[2], 3).tolist()} from 1 to {OCTAVES[-1]} cycles per image"
        )


if __name__ == "__main__":
    main()
