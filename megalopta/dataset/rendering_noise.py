"""What is known of the rendering's noise, from the headers of a dataset's frames.

median_relative, rms_over_mean     over the measured frames, median and mean square
equivalent_photons_per_pixel       Poisson counts that scatter as much as pixels of the median block
mean, covariance                   of bands and of their noise, averaged over measured frames
detail                             of the scene, like covariance: half the mean product of the
                                   differences between neighboring pixels, less that of the noise
measured_frames                    numbers of the frames that were measured, from 0
samples_per_pixel, median_relative_of_frames, rms_over_mean_of_frames
                                   of every frame; between measured frames, interpolated
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.dataset.store import Dataset
from megalopta.errors import UserError
from megalopta.render import RenderNoise, read_attributes, read_radiance

ATTRIBUTE = "monteCarlo"
"""Name of the header attribute with a measured frame's noise."""

_MOST_READ = 4
"""Frames whose detail is looked at."""


def noise_record(dataset: Dataset, samples_per_pass: int) -> dict[str, Any] | None:
    """Collect the noise of all frames for the scene record; None where none was measured."""
    frames = range(dataset.configuration.trajectory.frames)
    found = {index: noise for index in frames if (noise := _noise(dataset, index))}
    if not found:
        return None
    measured = list(found)
    median = [each.median_relative for each in found.values()]
    rms = [each.rms_over_mean for each in found.values()]
    typical = float(np.median(median))
    return {
        "median_relative": typical,
        "rms_over_mean": float(np.sqrt(np.mean(np.square(rms)))),
        "equivalent_photons_per_pixel": 1 / max(typical, 1e-6) ** 2,
        "mean": np.mean([each.mean for each in found.values()], axis=0).tolist(),
        "covariance": np.mean([each.covariance for each in found.values()], axis=0).tolist(),
        "detail": _detail(dataset, found).tolist(),
        "measured_frames": measured,
        "samples_per_pixel": [
            samples_per_pass * (found[index].passes if index in found else 1) for index in frames
        ],
        "median_relative_of_frames": np.interp(frames, measured, median).tolist(),
        "rms_over_mean_of_frames": np.interp(frames, measured, rms).tolist(),
    }


def _detail(dataset: Dataset, found: Mapping[int, RenderNoise]) -> NDArray[np.float64]:
    """Covariance (B, B) between bands of what neighboring pixels differ by, without noise."""
    some = list(found)[:: math.ceil(len(found) / _MOST_READ)]
    details = [
        neighbor_differences(read_radiance(dataset.radiance(index))[0]) - found[index].covariance
        for index in some
    ]
    return np.asarray(np.mean(details, axis=0))


def neighbor_differences(radiance: NDArray[np.float32]) -> NDArray[np.float64]:
    """Half the mean product (B, B) of the differences between neighbors in rows and columns."""
    pixels = radiance.astype(np.float64)
    bands = pixels.shape[-1]
    along = [np.diff(pixels, axis=axis).reshape(-1, bands) for axis in (0, 1)]
    differences = np.concatenate(along)
    return differences.T @ differences / (2 * max(len(differences), 1))


def _noise(dataset: Dataset, index: int) -> RenderNoise | None:
    path = dataset.radiance(index)
    try:
        text = read_attributes(path).get(ATTRIBUTE)
        return RenderNoise.from_json(text) if text else None
    except (OSError, ValueError, TypeError, KeyError) as problem:
        raise UserError(f"{path} cannot be read ({problem}); remove it and render again") from None
