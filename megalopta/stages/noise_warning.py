"""Check that rendering noise is small against shot noise and the scene's detail.

Motion is read from differences between neighboring pixels. Rendering noise, which flickers like
texture that does not move, is harmless where it is small against either of the others. Pixels of
sky are excluded, as motion is read elsewhere; a picture of sky alone uses all.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.config.model import Configuration
from megalopta.core.quantities import number
from megalopta.dataset.record import ExposureStatistics
from megalopta.sensor import ImageSensor, detected_photons, expectation

LIMIT = 0.1
"""Largest share of the variance of shot noise and detail without a warning."""

_MOST_NAMED, _ALL_LIGHT = 3, 0.99


def variances(
    noise: Mapping[str, Any],
    settings: Configuration,
    sensor: ImageSensor,
    scale: NDArray[np.float64],
) -> tuple[float, float, float]:
    """Variances of a pixel's reading, averaged over the image: rendering noise, shot noise, detail.

    That of the rendering is from the covariance of the bands' noise and the sensor's response to
    each band, that of shot noise from Poisson arrivals of light and dark counts; detail is half the
    mean square difference of neighbors without noise. `noise` is `monte_carlo` of the scene record,
    `scale` (B,) the factor per band from rendered to exposed light.
    """
    bands, camera = settings.render.bands_nm, settings.camera
    shape = len(bands), camera.height, camera.width, len(bands)
    unit = max(noise["mean"]) or 1.0  # sensors refuse absurdly bright light
    one_band_each = np.broadcast_to(unit * np.diag(scale)[:, None, None, :], shape)
    photons = detected_photons(one_band_each, bands, sensor).reshape(len(bands), -1) / unit
    dark = expectation(np.zeros((1, *shape[1:])), bands, sensor).mean_events
    arrivals = np.array(noise["mean"]) @ photons.mean(axis=1) + dark.mean()
    products = photons @ photons.T / photons.shape[1]
    rendering = np.sum(products * np.array(noise["covariance"]))
    detail = np.sum(products * np.array(noise["detail"])) if "detail" in noise else 0.0
    return float(rendering), float(arrivals), max(float(detail), 0.0)


def light_note(exposures: Iterable[ExposureStatistics]) -> str:
    """Return a sentence on the share of light in the darkest exposures; "" if all is light."""
    shares = defaultdict[str, list[tuple[float, float]]](list)
    for exposure in exposures:
        if exposure.light_fraction is not None and exposure.light_fraction < _ALL_LIGHT:
            shares[exposure.name].append((exposure.light_fraction, exposure.snr or 0.0))
    if not shares:
        return ""
    means = sorted((*np.mean(pairs, axis=0), name) for name, pairs in shares.items())
    named = [f"{name} {number(100 * share)} %, {number(snr)}" for share, snr, name in means]
    is_lost = bool(min(snr for _, snr, _ in means) < 1)
    remedy = ["give more light, or a sensor with fewer dark counts"] * is_lost
    return f"light among all counts, SNR of a pixel: {'; '.join(named[:_MOST_NAMED] + remedy)}"


def noise_warning(
    noise: Mapping[str, Any], settings: Configuration, shares: Mapping[str, float]
) -> str | None:
    """Return a sentence on exposures with too much rendering noise; None if there are none.

    The suggested samples suffice: variance falls at least as fast as their number grows. `shares`
    are variances of rendering noise over those of shot noise and detail, of exposures by name.
    """
    noisy = sorted((share, name) for name, share in shares.items() if share > LIMIT)
    if not noisy:
        return None
    now, named = max(noise["samples_per_pixel"]), list[str]()
    for share, name in noisy[:_MOST_NAMED]:
        samples = now * share / LIMIT
        step = int(10 ** max(math.floor(math.log10(samples)) - 1, 0))  # two digits
        remedy = f"use render.samples_per_pixel {math.ceil(samples / step) * step}, now {now}"
        if settings.render.target_error is not None:
            aim = noise["rms_over_mean"] * math.sqrt(LIMIT / share)
            remedy = f"use render.target_error {aim:.2g}"
        named.append(f"{name} {math.sqrt(share):.2g} ({remedy})")
    if len(noisy) > _MOST_NAMED:
        named.append(f"and {len(noisy) - _MOST_NAMED} worse")
    return (
        f"rendering noise is more than {math.sqrt(LIMIT):.1g} of shot noise and the "
        f"scene's detail together in {len(noisy)} of {len(shares)} exposures: {', '.join(named)}"
    )
