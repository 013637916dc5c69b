"""Photon counts of somebody's pictures, in one call."""

from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from megalopta.core.bounded import check_decoded
from megalopta.core.errors import UserError, refused_as
from megalopta.core.pictures import SENSED_BYTES
from megalopta.core.progress import say
from megalopta.core.validation import checked
from megalopta.dataset.picture_light import photons_per_lux
from megalopta.render.settings import RenderSettings
from megalopta.scenes import Light
from megalopta.scenes.stimuli.pictures import ColorsAsLight, Unit
from megalopta.sensor import Exposure, expose
from megalopta.sensor.image_sensors import sensor_named

if TYPE_CHECKING:
    from megalopta.render import Footage


def photons_from_images(
    images: Any,
    photons_per_pixel: float | None = None,
    sensor: Any = "ideal",
    *,
    lux: float | None = None,
    unit: Unit | None = None,
    seed: int = 0,
    **colors: Any,
) -> Exposure:
    """Return a sensor's readings of pictures: `counts`, `saturated` and `expectation`.

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
        When pictures cannot be read, nothing says how bright they are, or the sensor cannot expose
        them.

    Examples
    --------
    >>> gray = np.full((8, 32, 32), 0.5)
    >>> exposure = photons_from_images(gray, photons_per_pixel=2, unit="linear")
    >>> exposure.counts.shape, round(float(exposure.expectation.mean_reading.mean()), 2)
    ((8, 32, 32), 2.0)
    """
    brightness = lux if photons_per_pixel is None else photons_per_pixel
    is_number = isinstance(brightness, Real) and 0 < brightness < np.inf
    if not is_number or (photons_per_pixel is None) == (lux is None):
        raise UserError("photons_from_images: give photons_per_pixel or lux, a number above 0")
    with refused_as("photons_from_images"), _opened(images, unit) as footage:
        check_decoded(footage.path, (len(footage), *footage.shape), SENSED_BYTES)
        device = sensor_named(sensor)
        model = checked(ColorsAsLight, colors)
        mean = np.mean([footage.mean(index) for index in range(len(footage))], axis=0)
        if not mean.any():
            raise ValueError("the pictures are black; give pictures with light")
        bands = footage.bands_nm or RenderSettings().bands_nm
        dim = model.radiance_of_unit(Light(), bands, mean, footage.bands_nm)
        per_lux = photons_per_lux(dim, Light(), bands, device, mean)
        asked_lux = brightness if photons_per_pixel is None else photons_per_pixel / per_lux
        lit = checked(Light, {"illuminance_lux": asked_lux})
        of_unit = model.radiance_of_unit(lit, bands, mean, footage.bands_nm)
        for note in footage.notes:
            say(note)
        light = np.stack([footage.frame(index) @ of_unit for index in range(len(footage))])
        return expose(light, bands, device, seed=seed, stream="pictures", expectation=True)


def _opened(images: ArrayLike | str | Path, unit: Unit | None) -> "Footage":
    from megalopta.render import open_footage
    from megalopta.render.footage.pictures import ArrayFrames

    if isinstance(images, str | Path):
        return open_footage(Path(images), unit)
    values = np.asarray(images)
    if unit not in (None, *get_args(Unit)):
        raise UserError(f"unit {unit!r} is unknown: use one of {', '.join(get_args(Unit))}")
    if unit is None and values.dtype.kind != "u":
        raise UserError(
            f"photons_from_images: pictures of {values.dtype} do not say what their numbers are; "
            "give unit='srgb' (coded, 0 to 1), 'linear' or 'cd/m2'"
        )
    return ArrayFrames(values, unit or "srgb", Path("images"))
