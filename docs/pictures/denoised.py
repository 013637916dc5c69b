"""Rendered views for flight.py and views.py, denoised for display, and their counts.

Intel Open Image Denoise (`pip install pyoidn`) estimates the light, guided by the albedo, which is
known without noise. The estimate is biased, so it is never data: counts come from the light as
rendered.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pyoidn import denoise
from skimage.measure import block_reduce

from megalopta.config.model import Configuration
from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.report.images import gray_scale
from megalopta.scenes import preview
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.scene import Scene
from megalopta.sensor import expose
from megalopta.stages.render import build


def fine_albedo(
    scene: Scene, camera: Camera, settings: RenderSettings, poses: NDArray[Any]
) -> NDArray[np.float32]:
    """Return the albedo (T, H, W, bands) at poses, a mean of four points of each pixel."""
    size = {"width": 2 * camera.width, "height": 2 * camera.height}
    finer = SceneRenderer(scene, camera.model_copy(update=size), settings)
    return np.stack([block_reduce(finer.albedo(pose), (2, 2, 1), np.mean) for pose in poses])


def denoised(radiance: NDArray[Any], albedo: NDArray[Any]) -> NDArray[np.float32]:
    """Return radiance (H, W, bands) without its noise; three bands at a time, as those of color."""
    light, mean = np.empty_like(radiance), radiance.mean()
    for first in range(0, radiance.shape[-1], 3):
        three = np.arange(first, first + 3) % radiance.shape[-1]
        scaled = np.ascontiguousarray(radiance[..., three] / mean)
        clean = denoise(scaled, albedo[..., three], hdr=True, clean_aux=True)
        light[..., three] = mean * clean
    return light


def seen(settings: Configuration) -> tuple[Image.Image, NDArray[Any], float]:
    """Return the first view, the counts (H, W) of the first sensor, and its exposure, s."""
    scene, pose = build(settings), settings.trajectory.poses()[:1]
    camera, bands_nm, sensor = settings.camera, settings.render.bands_nm, settings.sensors[0]
    renderer = SceneRenderer(scene, camera, settings.render, pose)
    radiance = renderer.radiance(pose[0], frame_seed(settings.seed, 0))
    light = denoised(radiance, fine_albedo(scene, camera, settings.render, pose)[0])
    view = Image.fromarray(preview(light, bands_nm, settings.scene.white(settings.light)))
    counts = expose(radiance[None], bands_nm, sensor, seed=settings.seed, stream="view").counts
    return view, counts[0], sensor.exposure_s


def gray_counts(counts: NDArray[Any]) -> Image.Image:
    """Return counts (H, W) as a picture, from black to the brightest 1 %."""
    values = np.asarray(counts, dtype=np.float64)
    return gray_scale(max(float(np.percentile(values, 99)), 1.0)).picture(values).convert("RGB")
