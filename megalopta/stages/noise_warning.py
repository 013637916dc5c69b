"""Whether the rendering's noise is well below what a motion detector has to work with.

Motion is read from differences between neighboring pixels. Three things make them: the scene's
detail, shot noise and the rendering's noise, which flickers like texture that does not move. Where
the last is small beside either of the others it does no harm: hidden in shot noise, or faint beside
the detail. In bright light no rendering is as clean as the photons are.

Compared are variances of a pixel's reading, averaged over the image: that of the rendering, from
the covariance of the bands' noise and what the sensor makes of each band, that of Poisson arrivals,
light and dark counts together, and half the mean square that neighbors differ by without noise.
All are of pixels without sky, where motion is read; in a picture of sky alone, of all. The error of
baked light is part of the rendering's.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.config.model import Configuration
from megalopta.sensor import ImageSensor, detected_photons, expectation

LIMIT = 0.1
"""Largest share of the variance of shot noise and detail that goes without a warning."""

_MOST_NAMED = 3


def noise_share(
    noise: Mapping[str, Any],
    settings: Configuration,
    sensor: ImageSensor,
    scale: NDArray[np.float64],
) -> float:
    """Return variance of the rendering's noise over that of shot noise and detail, `variances`."""
    rendering, shot, detail = variances(noise, settings, sensor, scale)
    return rendering / max(shot + detail, 1e-300)


def variances(
    noise: Mapping[str, Any],
    settings: Configuration,
    sensor: ImageSensor,
    scale: NDArray[np.float64],
) -> tuple[float, float, float]:
    """Variances of a pixel's reading: the rendering's noise, shot noise, the scene's detail.

    `noise` is `monte_carlo` of the scene record, `scale` (B,) the factor from the rendered light to
    the exposed, per band.
    """
    bands, camera = settings.render.bands_nm, settings.camera
    shape = len(bands), camera.height, camera.width, len(bands)
    unit = max(noise["mean"]) or 1.0  # sensors refuse light that is absurdly bright
    one_band_each = np.broadcast_to(unit * np.diag(scale)[:, None, None, :], shape)
    photons = detected_photons(one_band_each, bands, sensor).reshape(len(bands), -1) / unit
    dark = expectation(np.zeros((1, *shape[1:])), bands, sensor).mean_events
    arrivals = np.array(noise["mean"]) @ photons.mean(axis=1) + dark.mean()
    products = photons @ photons.T / photons.shape[1]
    rendering = np.sum(products * np.array(noise["covariance"]))
    detail = np.sum(products * np.array(noise["detail"])) if "detail" in noise else 0.0
    return float(rendering), float(arrivals), max(float(detail), 0.0)


def noise_warning(
    noise: Mapping[str, Any], settings: Configuration, shares: Mapping[str, float]
) -> str | None:
    """One sentence on the exposures that the rendering is too noisy for; None where there are none.

    The samples named are enough: variance falls at least as fast as their number grows. `shares`
    are the `noise_share` of exposures by their names.
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
        f"the rendering's own noise is more than {math.sqrt(LIMIT):.1g} of shot noise and the "
        f"scene's detail together in {len(noisy)} of {len(shares)} exposures: {named}"
    )


def _remedy(noise: Mapping[str, Any], settings: Configuration, share: float) -> str:
    if settings.render.target_error is not None:
        aim = noise["rms_over_mean"] * math.sqrt(LIMIT / share)
        return f"render.target_error {aim:.2g} would do"
    now = max(noise["samples_per_pixel"])
    return f"render.samples_per_pixel {_two_digits(now * share / LIMIT)} would do, now {now}"


def _two_digits(samples: float) -> int:
    """Round up to two digits."""
    step = int(10 ** max(math.floor(math.log10(samples)) - 1, 0))
    return math.ceil(samples / step) * step
