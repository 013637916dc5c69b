"""Rendered light without its noise, for pictures that show what a scene looks like.

Intel Open Image Denoise estimates it, guided by the albedo, which is known without noise. The
estimate is biased, so it is never data: counts and figures come from the light as rendered.
"""

import numpy as np
from numpy.typing import NDArray
from skimage.measure import block_reduce

from megalopta.config.model import Configuration
from megalopta.core.arrays import Floats
from megalopta.render import SceneRenderer
from megalopta.scenes.scene import Scene

try:
    from pyoidn import denoise
except ModuleNotFoundError:  # macOS and ARM have no wheel of it: pictures keep their noise
    denoise = None

_FINER = 2
"""Rays along each side of a pixel, over which its albedo is averaged"""

NOTE = "denoised for display (Intel Open Image Denoise)" if denoise else "as rendered"
"""What captions say of a picture"""


def pixel_albedo(scene: Scene, settings: Configuration, pose: Floats) -> NDArray[np.float32] | None:
    """Return the mean albedo (H, W, B) of every pixel seen from a pose (4, 4).

    None without the denoiser, and where light has no noise to remove: from photographs and from
    surfaces that glow.
    """
    if denoise is None or scene.environment or not scene.lighting:
        return None
    camera = settings.camera
    size = {"width": _FINER * camera.width, "height": _FINER * camera.height}
    finer = SceneRenderer(scene, camera.model_copy(update=size), settings.render)
    albedo = block_reduce(finer.albedo(pose), (_FINER, _FINER, 1), np.mean)
    return np.asarray(albedo, np.float32)


def denoised(
    radiance: NDArray[np.float32], albedo: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    """Return an estimate of radiance (H, W, B) without noise; `albedo` (H, W, B) guides it.

    Without albedo or denoiser it is the radiance itself.
    """
    if denoise is None or albedo is None:
        return radiance
    bands, mean = radiance.shape[2], radiance.mean()
    light = np.empty_like(radiance)
    for first in range(0, bands, 3):  # three at a time, as those of a color
        own = np.arange(first, first + 3) % bands
        scaled = np.ascontiguousarray(radiance[..., own] / mean)
        light[..., own] = mean * denoise(scaled, albedo[..., own], hdr=True, clean_aux=True)
    return light
