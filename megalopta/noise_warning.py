"""Whether the rendering's noise is well below the shot noise of an exposure.

Compared are variances of a pixel's reading, averaged over the image: that of the rendering, from
the covariance of the bands' noise and what the sensor makes of each band, and that of Poisson
arrivals, light and dark counts together. A tenth makes the noise of the counts 5 % larger than the
light's own.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.configuration import Configuration
from megalopta.sensor import ImageSensor, detected_photons, expected_reading

LIMIT = 0.1
"""Largest share of the shot noise's variance that goes without a warning."""

_MOST_NAMED = 3


def noise_share(
    noise: Mapping[str, Any],
    settings: Configuration,
    sensor: ImageSensor,
    scale: NDArray[np.float64],
) -> float:
    """Variance of the rendering's noise over that of the shot noise.

    Parameters
    ----------
    noise : mapping
        `monte_carlo` of the scene record.
    settings : Configuration
        Of the dataset.
    sensor : Sensor or CtiaSensor
    scale : (B,)
        Factor from the rendered light to the exposed, per band.
    """
    bands, camera = settings.render.bands_nm, settings.camera
    shape = len(bands), camera.height, camera.width, len(bands)
    one_band_each = np.broadcast_to(np.diag(scale)[:, None, None, :], shape)
    photons = detected_photons(one_band_each, bands, sensor).reshape(len(bands), -1)
    dark = expected_reading(np.zeros((1, *shape[1:])), bands, sensor)
    arrivals = np.array(noise["mean"]) @ photons.mean(axis=1) + dark.mean()
    products = photons @ photons.T / photons.shape[1]
    variance = np.sum(products * np.array(noise["covariance"]))
    return float(variance / max(arrivals, 1e-300))


def noise_warning(
    noise: Mapping[str, Any], settings: Configuration, shares: Mapping[str, float]
) -> str | None:
    """One sentence on the exposures that the rendering is too noisy for; None where there are none.

    The samples named are enough: variance falls at least as fast as their number grows.

    Parameters
    ----------
    noise : mapping
        `monte_carlo` of the scene record.
    settings : Configuration
        Of the dataset.
    shares : mapping
        Name of each exposure to its `noise_share`.
    """
    noisy = sorted((share, name) for name, share in shares.items() if share > LIMIT)
    if not noisy:
        return None
    named = ", ".join(
        f"{name} {math.sqrt(share):.2g} ({_remedy(noise, settings, share)})"
        for share, name in noisy[:_MOST_NAMED]
    )
    if len(noisy) > _MOST_NAMED:
        named += f", and {len(noisy) - _MOST_NAMED} worse"
    return (
        f"the rendering's own noise is more than {math.sqrt(LIMIT):.1g} of the shot noise in "
        f"{len(noisy)} of {len(shares)} exposures: {named}"
    )


def _remedy(noise: Mapping[str, Any], settings: Configuration, share: float) -> str:
    if settings.render.target_error is not None:
        aim = noise["median_relative"] * math.sqrt(LIMIT / share)
        return f"render.target_error {aim:.2g} would do"
    now = max(noise["samples_per_pixel"])
    return f"render.samples_per_pixel {_two_digits(now * share / LIMIT)} would do, now {now}"


def _two_digits(samples: float) -> int:
    """Round up to two digits."""
    step = int(10 ** max(math.floor(math.log10(samples)) - 1, 0))
    return math.ceil(samples / step) * step
