"""Photon counts of somebody's pictures, in one call."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from megalopta.core.errors import UserError
from megalopta.dataset.picture_light import photons_per_lux
from megalopta.render.settings import RenderSettings
from megalopta.scenes import Light
from megalopta.scenes.stimuli.pictures import ColorsAsLight, Unit
from megalopta.sensor import IMAGE_SENSORS, Expectation, Exposure, expose

if TYPE_CHECKING:
    from megalopta.render import Footage

_MOMENTS = [each.name for each in fields(Expectation)]


def photons_from_images(
    images: ArrayLike | str | Path,
    photons_per_pixel: float | None = None,
    sensor: Any = "ideal",
    *,
    lux: float | None = None,
    unit: Unit | None = None,
    seed: int = 0,
    **colors: Any,
) -> Exposure:
    """Return what a sensor reads of pictures: `counts`, `saturated` and `expectation`.

    Parameters
    ----------
    images
        Pictures (T, H, W) or (T, H, W, 3), one of them, or the path of a video, a picture, a folder
        of pictures or an array.
    photons_per_pixel : float
        Mean photons on a pixel in an exposure, over all pictures.
    sensor
        A preset's name, or a sensor.
    lux : float
        Illuminance of the scene, in place of `photons_per_pixel`.
    unit : {"srgb", "linear", "cd/m2"}
        Unit of arrays; uint8 and uint16 are sRGB codes by default.
    seed : int
    **colors
        `reflectance` and `spectrum`, as of `megalopta.scenes.Pictures`.

    Returns
    -------
    Exposure
        counts (T, H, W), and in `expectation` the `mean_reading` without noise, `photons` and
        variances, of the same shape.

    Raises
    ------
    UserError
        When pictures cannot be read, or nothing says how bright they are.
    """
    if (photons_per_pixel is None) == (lux is None):
        raise UserError("photons_from_images: give photons_per_pixel or lux, one of them")
    device = IMAGE_SENSORS[sensor] if isinstance(sensor, str) else sensor
    model, light, bands = ColorsAsLight(**colors), Light(), RenderSettings().bands_nm
    with _opened(images, unit) as footage:
        mean = np.mean([footage.mean(index) for index in range(len(footage))], axis=0)
        per_lux = photons_per_lux(model, light, bands, device, mean)
        asked_lux = lux if photons_per_pixel is None else photons_per_pixel / per_lux
        lit = Light(illuminance_lux=asked_lux)
        of_unit = model.radiance_of_unit(lit, bands, mean)
        lights = (footage.frame(index) @ of_unit for index in range(len(footage)))
        exposures = [
            expose(
                each[np.newaxis],
                bands,
                device,
                seed=seed,
                sequence="pictures",
                first_frame=index,
                expectation=True,
            )
            for index, each in enumerate(lights)
        ]
    return _joined(exposures)


def _opened(images: ArrayLike | str | Path, unit: Unit | None) -> "Footage":
    from megalopta.render import open_footage
    from megalopta.render.footage.arrays import array_frames

    if isinstance(images, str | Path):
        return open_footage(Path(images), unit)
    values = np.asarray(images)
    if unit is None and values.dtype.kind != "u":
        raise UserError(
            f"photons_from_images: pictures of {values.dtype} do not say what their numbers are; "
            "give unit='srgb' (coded, 0 to 1), 'linear' or 'cd/m2'"
        )
    return array_frames(values, unit or "srgb", Path("images"))


def _joined(exposures: Sequence[Exposure]) -> Exposure:
    """Return frames of several exposures as one."""
    stated = [each.expectation for each in exposures if each.expectation]
    moments = (np.concatenate([getattr(each, name) for each in stated]) for name in _MOMENTS)
    counts, saturated = (
        np.concatenate([getattr(each, name) for each in exposures])
        for name in ("counts", "saturated")
    )
    return Exposure(counts, saturated, Expectation(*moments))
