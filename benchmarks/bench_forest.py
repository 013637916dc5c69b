"""What level of detail gains on a forest of 1000 trees, and what it changes in the image.

Reference: the same forest with every plant drawn in full, rendered in turn with it, view by view.
Statistics of the image are free of Monte Carlo noise: powers are cross powers of two renderings
with independent noise. Takes a minute or two and 8 GB.
"""

import time

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene

CAMERA = PerspectiveCamera(width=251, height=251, fov_deg=100)
# The camera looks once around.
VIEWS = Trajectory(frames=6, frame_rate_hz=1, rotation_deg_s=60)
SETTINGS = RenderSettings(samples_per_pixel=16, max_depth=4, bands_nm=((500, 600),))
OCTAVES = (1, 2, 4, 8, 16, 32, 64, 125)
"""Limits of the bands of the power spectrum (cycles per image)."""


def loaded(detail: float) -> SceneRenderer:
    start = time.process_time()
    scene = build_scene(Forest(trees=1000, detail=detail), Light(), CAMERA, VIEWS)
    grown = time.process_time()
    renderer = SceneRenderer(scene, CAMERA, SETTINGS)
    renderer.radiance(VIEWS.poses()[0], seed=0)  # compiles kernels
    print(
        f"detail {detail:g}: {scene.triangle_count:,} triangles, built in "
        f"{grown - start:.1f} CPU-s, loaded in {time.process_time() - grown:.1f}"
    )
    return renderer


def rendered(
    renderers: list[SceneRenderer],
) -> tuple[NDArray[np.float64], list[float]]:
    """Images (renderer, half, view, H, W) and the CPU-seconds that each renderer took."""
    poses = VIEWS.poses()
    images = np.empty((len(renderers), 2, len(poses), CAMERA.height, CAMERA.width))
    seconds = [0.0] * len(renderers)
    for half, view in np.ndindex(2, len(poses)):
        for index, renderer in enumerate(renderers):
            start = time.process_time()
            images[index, half, view] = renderer.radiance(poses[view], 100 * half + view)[..., 0]
            seconds[index] += time.process_time() - start
    return images, seconds


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
    images, seconds = rendered([loaded(1.0), loaded(1000.0)])
    near, full = (statistics(halves) for halves in images)
    samples = images[0].size * SETTINGS.samples_per_pixel / 1e6
    print(
        f"{mi.variant()}, {CAMERA.width} px, {SETTINGS.samples_per_pixel} samples:\n"
        f"  million samples per CPU-second  {samples / seconds[0]:.3f} with levels of detail, "
        f"{samples / seconds[1]:.3f} in full: {seconds[1] / seconds[0]:.2f} times\n"
        f"  mean radiance, ratio            {near[0] / full[0]:.4f} (required: within 2 %)\n"
        f"  contrast, ratio                 {near[1] / full[1]:.4f}\n"
        f"  power per octave, ratio         {np.round(near[2] / full[2], 3).tolist()}, "
        f"from 1 to {OCTAVES[-1]} cycles per image"
    )


if __name__ == "__main__":
    main()
